"""What a room was drawn from, for the scripts that build it again to render or measure it otherwise."""

from __future__ import annotations

from pathlib import Path

from engine.core.errors import SettingsError
from engine.core.files import optional, read_json

_ROOM = {"seed": int, "attempt": int, "exhibits": optional(str)}


def drawn_from(room: Path) -> list[str]:
    """Return the arguments by which a script of `demo/random_rooms` draws a room again.

    Parameters
    ----------
    room : Path
        With ``truth/room.json``.

    Raises
    ------
    FormatError
        When that file cannot be read.
    SettingsError
        When the exhibits are 3D models of other people: with the same seed, the scripts would build our own instead.
    """
    file = room / "truth" / "room.json"
    made = read_json(file, _ROOM, advice="Render the room again.")
    if made.get("exhibits", "own") != "own":
        raise SettingsError(f"{room} shows 3D models of other people, which only `make model-rooms` can measure.")
    return ["--seed", str(made["seed"]), "--attempt", str(made["attempt"])]
