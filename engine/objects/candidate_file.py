"""What came nearest to a text that was refused: ``objects/candidates.json``, small pictures, and seed masks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, PromptError
from ..pictures import write_png
from ..project_folder import write_json
from .candidates import Candidate
from .photos import Photos

__all__ = ["CANDIDATES", "KeptCandidate", "forget_candidates", "load_candidate", "remember_candidates"]

CANDIDATES = "objects/candidates.json"
_PICTURES = "objects/_candidates"
_VERSION = 1
_MOST = 5
_PICTURE_SIDE = 256
_MARGIN = 0.4


@dataclass(frozen=True)
class KeptCandidate:
    """A candidate that may still be accepted: what was asked for, how well it fits, and its mask in a photo."""

    text: str
    score: float
    photo: str
    mask: Path


def forget_candidates(project: Path) -> None:
    """Remove the candidates of earlier texts."""
    (project / CANDIDATES).unlink(missing_ok=True)
    shutil.rmtree(project / _PICTURES, ignore_errors=True)


def remember_candidates(
    project: Path, text: str, message: str, candidates: Sequence[tuple[float, Candidate]], photos: Photos | None
) -> None:
    """Add a refused text, and what came nearest to it, to the candidates of the project.

    Parameters
    ----------
    project : Path
    text, message : str
        What was asked for, and the sentence that refused it.
    candidates : sequence of (float, Candidate)
        The best first; at most five are kept.
    photos : Photos or None
        Needed where there are candidates.

    Raises
    ------
    DiskError
        When it cannot be written.
    """
    known = _read(project) if (project / CANDIDATES).is_file() else {"refused": [], "candidates": []}
    refused = [entry for entry in known["refused"] if entry["text"] != text] + [{"text": text, "message": message}]
    entries = [entry for entry in known["candidates"] if entry["text"] != text]
    number = max((entry["number"] for entry in known["candidates"]), default=0)
    for score, candidate in candidates[:_MOST]:
        assert photos is not None
        number += 1
        entries.append(_entry(project, number, text, score, candidate, photos))
    created = datetime.now(UTC).isoformat(timespec="microseconds")
    write_json(
        project / CANDIDATES,
        {"version": _VERSION, "created": created, "refused": refused, "candidates": entries},
    )


def _entry(project: Path, number: int, text: str, score: float, candidate: Candidate, photos: Photos) -> dict[str, Any]:
    seed = candidate.seeds[0]
    camera = seed.view.camera
    mask = seed.view.to_photo(seed.mask)
    if not mask.any():
        # A mask of a few pixels in the smaller frame may vanish at the photo's size.
        mask[camera.height // 2, camera.width // 2] = True
    inner = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(int(inner.argmax()), inner.shape)
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    box = [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1]
    picture = f"{_PICTURES}/{number}.png"
    write_png(project / picture, _picture(photos.pixels(camera), mask, box, photos.scale(camera)))
    write_png(project / _mask_of(number), np.where(mask, np.uint8(255), np.uint8(0)))
    return {
        "number": number,
        "text": text,
        "score": round(float(score), 4),
        "photo": camera.photo,
        "x": float(x) + 0.5,
        "y": float(y) + 0.5,
        "box": [float(side) for side in box],
        "n_gaussians": int(candidate.best.members.sum()),
        "picture": picture,
    }


def _mask_of(number: int) -> str:
    return f"{_PICTURES}/{number}-mask.png"


def _picture(pixels: NDArray[np.uint8], mask: NDArray[np.bool_], box: Sequence[int], scale: float) -> NDArray[np.uint8]:
    """Cut the candidate out with some surroundings, which are darkened."""
    small = cv2.resize(mask.astype(np.uint8), (pixels.shape[1], pixels.shape[0]), interpolation=cv2.INTER_NEAREST) > 0
    x0, y0, x1, y1 = (side * scale for side in box)
    margin = _MARGIN * max(x1 - x0, y1 - y0) + 4
    left, top = max(0, int(x0 - margin)), max(0, int(y0 - margin))
    right, bottom = min(pixels.shape[1], int(x1 + margin)), min(pixels.shape[0], int(y1 + margin))
    part = pixels[top:bottom, left:right].copy()
    outside = ~small[top:bottom, left:right]
    part[outside] = part[outside] // 3
    factor = _PICTURE_SIDE / max(part.shape[:2])
    if factor < 1:
        size = (max(1, round(part.shape[1] * factor)), max(1, round(part.shape[0] * factor)))
        part = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
    return part


def load_candidate(project: Path, number: int) -> KeptCandidate:
    """Return the candidate with that number.

    Raises
    ------
    PromptError
        When there is none; the message lists those there are.
    FormatError
        When the file is damaged.
    """
    if not (project / CANDIDATES).is_file():
        raise PromptError("There are no candidates to accept: the last text was not refused. Ask for a text first.")
    entries = _read(project)["candidates"]
    found = next((entry for entry in entries if entry["number"] == number), None)
    if found is None:
        known = ", ".join(f"{entry['number']} ({entry['text']})" for entry in entries) or "none"
        raise PromptError(f"There is no candidate {number}. Known: {known}.")
    return KeptCandidate(found["text"], float(found["score"]), found["photo"], project / _mask_of(number))


def _read(project: Path) -> dict[str, Any]:
    file = project / CANDIDATES
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if data["version"] != _VERSION or not isinstance(data["candidates"], list):
            raise ValueError("its version is not known")
        return dict(data)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{file} cannot be read: {error}. Ask for the text again.") from error
