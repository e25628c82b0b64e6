"""Nearest candidates of refused texts: ``objects/candidates.json``, pictures of the candidates and their masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, PromptError
from ..files import delete_derived, read_json, write_json
from ..masks import mask_box
from ..pictures import write_png
from .found import FoundObject
from .photos import Photos
from .votes import THRESHOLD

__all__ = ["CANDIDATES", "StoredCandidate", "forget_candidates", "load_candidate", "remember_candidates"]

CANDIDATES = "objects/candidates.json"
_PICTURES = "objects/_candidates"
_VERSION = 1  # by definition
_ADVICE = "Ask for the text again."
_SCHEMA = {
    "version": int,
    "refused": [{"text": str, "message": str}],
    "candidates": [
        {
            "number": int,
            "text": str,
            "score": float,
            "photo": str,
            "x": float,
            "y": float,
            "box": [float],
            "n_gaussians": int,
            "picture": str,
        }
    ],
}

_MAX_STORED = 5  # by definition
"""Candidates of one text that are stored, at most."""

_PICTURE_SIDE = 256  # by definition
"""Longest side of a candidate's picture in pixels."""

_PICTURE_MARGIN = 0.4  # by definition
"""Margin around a candidate in its picture, relative to the longer side of its box."""


@dataclass(frozen=True)
class StoredCandidate:
    """A candidate that the user may still accept: its text, its score, and its mask in a photo."""

    text: str
    score: float
    photo: str
    mask: Path


def forget_candidates(project: Path) -> None:
    """Delete the candidates of earlier texts."""
    delete_derived(project, CANDIDATES)
    delete_derived(project, _PICTURES)


def remember_candidates(
    project: Path, text: str, message: str, candidates: Sequence[FoundObject], photos: Photos | None
) -> None:
    """Store a refused text and its nearest candidates in the project, beside those of other texts.

    Parameters
    ----------
    project : Path
    text : str
    message : str
        Why the text was refused.
    candidates : sequence of FoundObject
        The best first; at most five are stored.
    photos : Photos or None
        Required if there are candidates.

    Raises
    ------
    DiskError
        When a file cannot be written.
    """
    stored = _read(project) if (project / CANDIDATES).is_file() else {"refused": [], "candidates": []}
    refused = [entry for entry in stored["refused"] if entry["text"] != text] + [{"text": text, "message": message}]
    entries = [entry for entry in stored["candidates"] if entry["text"] != text]
    number = max((entry["number"] for entry in stored["candidates"]), default=0)
    for candidate in candidates[:_MAX_STORED]:
        assert photos is not None
        number += 1
        entries.append(_write_candidate(project, number, text, candidate, photos))
    created = datetime.now(UTC).isoformat(timespec="microseconds")
    write_json(
        project / CANDIDATES,
        {"version": _VERSION, "created": created, "refused": refused, "candidates": entries},
    )


def _write_candidate(project: Path, number: int, text: str, candidate: FoundObject, photos: Photos) -> dict[str, Any]:
    """Write the picture and the mask of a candidate and return its entry in the file."""
    evidence = candidate.evidence[0]
    camera = evidence.view.camera
    mask = evidence.view.to_photo(evidence.mask)
    if not mask.any():
        # A mask of a few pixels in the view's frame may vanish at the size of the photo.
        mask[camera.height // 2, camera.width // 2] = True
    distance = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(int(distance.argmax()), distance.shape)
    box = mask_box(mask)
    assert box is not None, "the mask has at least one pixel"
    picture = f"{_PICTURES}/{number}.png"
    write_png(project / picture, _picture(photos.pixels(camera), mask, box, photos.scale(camera)))
    write_png(project / _mask_name(number), np.where(mask, np.uint8(255), np.uint8(0)))
    return {
        "number": number,
        "text": text,
        "score": round(candidate.score, 4),
        "photo": camera.photo,
        "x": float(x) + 0.5,
        "y": float(y) + 0.5,
        "box": [float(side) for side in box],
        "n_gaussians": int((candidate.membership >= THRESHOLD).sum()),
        "picture": picture,
    }


def _mask_name(number: int) -> str:
    return f"{_PICTURES}/{number}-mask.png"


def _picture(pixels: NDArray[np.uint8], mask: NDArray[np.bool_], box: Sequence[int], scale: float) -> NDArray[np.uint8]:
    """Return a crop of the photo with the candidate and its darkened surroundings."""
    size = (pixels.shape[1], pixels.shape[0])
    small_mask = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    x0, y0, x1, y1 = (side * scale for side in box)
    margin = _PICTURE_MARGIN * max(x1 - x0, y1 - y0) + 4
    left, top = max(0, int(x0 - margin)), max(0, int(y0 - margin))
    right, bottom = min(pixels.shape[1], int(x1 + margin)), min(pixels.shape[0], int(y1 + margin))
    crop = pixels[top:bottom, left:right].copy()
    outside = ~small_mask[top:bottom, left:right]
    crop[outside] = crop[outside] // 3
    factor = _PICTURE_SIDE / max(crop.shape[:2])
    if factor < 1:
        size = (max(1, round(crop.shape[1] * factor)), max(1, round(crop.shape[0] * factor)))
        crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), np.uint8)
    return crop


def load_candidate(project: Path, number: int) -> StoredCandidate:
    """Return the candidate with that number.

    Raises
    ------
    PromptError
        When there is none; the message lists the existing candidates.
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
    return StoredCandidate(found["text"], float(found["score"]), found["photo"], project / _mask_name(number))


def _read(project: Path) -> dict[str, Any]:
    file = project / CANDIDATES
    data: dict[str, Any] = read_json(file, _SCHEMA, advice=_ADVICE)
    if data["version"] != _VERSION:
        raise FormatError(f"{file} was written by another version of Gaussian Heritage. {_ADVICE}")
    return data
