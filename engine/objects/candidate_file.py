"""Objects that a refused text may mean: ``objects/candidates.json``, their pictures and their Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..core.arrays import Float32, Mask, Pixels
from ..core.errors import FormatError, PromptError
from ..core.files import (
    ArraySpec,
    atomic_write,
    delete_derived,
    optional,
    path_within,
    read_arrays,
    read_json,
    write_json,
)
from ..pictures import write_png
from .votes import MaskEvidence

if TYPE_CHECKING:
    from .photos import Photos

CANDIDATES = "objects/candidates.json"
_PICTURES, _ARRAYS = "objects/_candidates", "objects/_candidates/{}.npz"
_VERSION = 1
_ADVICE = "Ask for the text again."
_SCHEMA = {
    "version": int,
    "refused": [
        {
            "text": str,
            "message": str,
            "suggestions": optional([str]),
            "objects": optional([str]),
            "offer": optional(str),
        }
    ],
    "candidates": [
        {
            "number": int,
            "text": str,
            "score": float,
            "photo": str,
            "object": optional((str, None)),
            "detector": str,
            "n_scene_gaussians": int,
            "graph": str,
            "fingerprint": str,
        }
    ],
}


@dataclass(frozen=True)
class StoredCandidate:
    """A candidate that the user may still accept.

    Attributes
    ----------
    text : str
        Refused text.
    score : float
        0 to 1.
    photo : str
    members, undecided, mask, example
        Those of its `MaskEvidence`; without `example` no rows.
    graph : str
        Key of the graph of the scene.
    detector, fingerprint : str
        Of the detector that was asked.
    object_id : str
        Id of the stored object that it is; empty for none.
    """

    text: str
    score: float
    photo: str
    members: Mask
    undecided: Mask
    mask: Mask
    example: Float32
    graph: str
    detector: str
    fingerprint: str
    object_id: str


def forget_candidates(project: Path) -> None:
    """Delete the candidates of earlier texts."""
    delete_derived(project, CANDIDATES)
    delete_derived(project, _PICTURES)


def remember_candidates(
    project: Path,
    text: str,
    message: str,
    candidates: Sequence[MaskEvidence],
    photos: Photos | None,
    *,
    suggestions: Sequence[str] = (),
    offer: str = "",
    alike: Sequence[str] = (),
    same: Sequence[str | None] = (),
    graph: str = "",
    detector: str = "",
    fingerprint: str = "",
) -> None:
    """Store a refused text, why it was refused, and its nearest candidates. Those of other texts stay.

    Parameters
    ----------
    candidates : sequence of MaskEvidence
        With their Gaussians and those that are undecided, the best first.
    photos : Photos or None
        Needed where there are candidates.
    suggestions : sequence of str
        Texts that may have been meant.
    offer : str
        Model of the catalogue that knows more words; empty for none.
    alike : sequence of str
        Ids of stored objects whose names are spelt nearly like the text.
    same : sequence of (str or None)
        For each candidate, the id of the object that it is.
    graph : str
        Key of the graph of the scene.
    detector, fingerprint : str
        Of the detector that was asked.

    Raises
    ------
    DiskError
        When a file cannot be written.
    """
    stored = _read(project) if (project / CANDIDATES).is_file() else {"refused": [], "candidates": []}
    refused = [entry for entry in stored["refused"] if entry["text"] != text] + [
        {"text": text, "message": message, "suggestions": list(suggestions), "objects": list(alike), "offer": offer}
    ]
    entries = [entry for entry in stored["candidates"] if entry["text"] != text]
    last = max((entry["number"] for entry in stored["candidates"]), default=0)
    known_as = [*same, *[None] * (len(candidates) - len(same))]
    for number, (candidate, object_id) in enumerate(zip(candidates, known_as, strict=True), last + 1):
        assert photos is not None and candidate.members is not None and candidate.undecided is not None
        view, picture = candidate.view, f"{_PICTURES}/{number}.png"
        mask = view.to_photo(candidate.mask)
        if not mask.any():
            # A mask of a few pixels in the view's frame may vanish at the size of the photo.
            mask[len(mask) // 2, mask.shape[1] // 2] = True
        write_png(project / picture, cut_out(photos.picture(view), mask))
        sets = ("members", "undecided", "mask")
        arrays: dict[str, Any] = {name: np.packbits(getattr(candidate, name), axis=-1) for name in sets}
        arrays["width"] = np.int64(candidate.mask.shape[1])
        if candidate.example is not None:
            arrays["example"] = candidate.example
        with atomic_write(project / _ARRAYS.format(number)) as stream:
            np.savez_compressed(stream, **arrays)
        framed = np.pad(mask, 1).astype(np.uint8)
        x, y = cv2.minMaxLoc(cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_3)[1:-1, 1:-1])[3]
        left, top, width, height = cv2.boundingRect(framed[1:-1, 1:-1])
        place = {"photo": view.camera.photo, "x": x, "y": y, "box": [left, top, left + width, top + height]}
        known = {
            "number": number,
            "text": text,
            "score": float(candidate.score),
            "picture": picture,
            "object": object_id,
            "detector": detector,
            "fingerprint": fingerprint,
            "graph": graph,
        }
        counts = {"n_gaussians": int(candidate.members.sum()), "n_scene_gaussians": len(candidate.members)}
        entries.append({**known, **place, **counts})
    content = {"created": datetime.now(UTC).isoformat(), "refused": refused, "candidates": entries}
    write_json(project / CANDIDATES, {"version": _VERSION, **content})


def cut_out(pixels: Pixels, mask: Mask) -> Pixels:
    """Return a crop of the photo around what is shown, with darkened surroundings.

    Parameters
    ----------
    pixels : array of shape [h, w, 3], uint8
    mask : array of shape [H, W], bool
        Of the full size of the photo.

    Returns
    -------
    array of shape [rows, columns, 3], uint8
    """
    # No mean over an area is 0 that a pixel of the mask lies in.
    inside = cv2.resize(mask.astype(np.float32), pixels.shape[1::-1], interpolation=cv2.INTER_AREA) > 0
    x, y, width, height = cv2.boundingRect(inside.astype(np.uint8))
    margin = max(width, height) // 2
    rows, columns = slice(max(0, y - margin), y + height + margin), slice(max(0, x - margin), x + width + margin)
    return np.where(inside[..., None], pixels, pixels // 2)[rows, columns]


def load_candidate(project: Path, number: int) -> StoredCandidate:
    """Return the candidate with that number.

    Raises
    ------
    PromptError
        When there is none.
    FormatError
        When the file is damaged.
    """
    if not (project / CANDIDATES).is_file():
        raise PromptError("There are no candidates to accept: the last text was not refused. Ask for a text first.")
    stored = {entry["number"]: entry for entry in _read(project)["candidates"]}
    if (found := stored.get(number)) is None:
        known = ", ".join(f"{other} ({entry['text']})" for other, entry in stored.items()) or "none"
        raise PromptError(f"There is no candidate {number}. Known: {known}.")
    count, file = found["n_scene_gaussians"], path_within(project, *_ARRAYS.format(number).split("/"))
    sets = ArraySpec("uint8", (max(0, -(-count // 8)),))
    specs = {
        "members": sets,
        "undecided": sets,
        "mask": ArraySpec("uint8", ("h", "w")),
        "width": ArraySpec("int64", ()),
    }
    read = read_arrays(file, specs, advice=_ADVICE, optional={"example": ArraySpec("float32", ("e",), finite=True)})
    width, mask = int(read["width"]), read["mask"]
    if not 8 * (mask.shape[1] - 1) < width <= 8 * mask.shape[1]:
        raise FormatError(f"{file} is damaged. {_ADVICE}")
    return StoredCandidate(
        text=found["text"],
        score=float(found["score"]),
        photo=found["photo"],
        members=np.unpackbits(read["members"], count=count).astype(bool),
        undecided=np.unpackbits(read["undecided"], count=count).astype(bool),
        mask=np.unpackbits(mask, axis=1, count=width).astype(bool),
        example=read.get("example", np.zeros(0, np.float32)),
        graph=found["graph"],
        detector=found["detector"],
        fingerprint=found["fingerprint"],
        object_id=found.get("object") or "",
    )


def _read(project: Path) -> dict[str, Any]:
    data: dict[str, Any] = read_json(project / CANDIDATES, _SCHEMA, advice=_ADVICE)
    if data["version"] != _VERSION:
        raise FormatError(f"{project / CANDIDATES} was written by another version of Gaussian Heritage. {_ADVICE}")
    return data
