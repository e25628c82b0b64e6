# SPDX-License-Identifier: GPL-3.0-or-later
"""What a folder holds of a room, read without Blender."""

from __future__ import annotations

import json
from pathlib import Path

ROOM_FILE = "room.json"
_TEXTS = ("truth/names.json", "truth/absent.json", "cameras/cameras.txt", "cameras/images.txt", "cameras/points3D.txt")


class OtherRoomError(Exception):
    """A folder holds another room."""


def accepted_attempt(out: Path, seed: int, family: str = "own") -> int | None:
    """Return the attempt that a folder holds, None when it holds no room yet.

    Parameters
    ----------
    out, seed
    family
        Whose exhibits the room shows: "own", or "models" of other people.

    Raises
    ------
    OtherRoomError
        When the folder holds the room of another seed or of other exhibits, or a file of that name that was not
        written here.
    """
    known = out / "truth" / ROOM_FILE
    if not known.exists():
        return None
    try:
        room = json.loads(known.read_text(encoding="utf-8"))
        held, attempt, shown = int(room["seed"]), int(room["attempt"]), str(room.get("exhibits", "own"))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise OtherRoomError(f"{known} is damaged; delete {out} or choose another --out.") from error
    if shown != family:
        raise OtherRoomError(f"{out} holds a room with exhibits of {shown!r}, not of {family!r}; choose another --out.")
    if held != seed:
        raise OtherRoomError(f"{out} holds the room of seed {held}, not of {seed}; choose another --out.")
    return attempt


def is_complete(out: Path) -> bool:
    """Return whether all files of a room exist."""
    cameras = out / "truth" / "cameras.json"
    if not cameras.exists() or not all((out / name).exists() for name in _TEXTS):
        return False
    names = [Path(photo["file"]).stem for photo in json.loads(cameras.read_text(encoding="utf-8"))["photos"]]
    files = [file for name in names for file in (out / f"photos/{name}.jpg", out / f"truth/masks/{name}.png")]
    return all(file.exists() for file in files)
