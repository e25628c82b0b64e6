"""Label maps on disk: ``masks/<photo name>.npz``, in the same sub-folders as the photos."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError, MaskError
from ..core.files import ArraySpec, atomic_write, derived_name, parse_json, path_within, read_arrays

_VERSION = 1
_ARRAYS = {"labels": ArraySpec("int32", ("h", "w")), "header": ArraySpec("str", ())}
_ADVICE = "Delete it and run `reconstruct` again."
_MAX_SEGMENTS = 1 << 20
"""Largest segment id. Segments are counted in arrays of this length; a photo has at most some hundred."""


def label_map_path(folder: Path, photo: str) -> Path:
    """Return the path of the label map of the photo called `photo` in the masks folder `folder`."""
    # The photo's suffix is kept, because a.jpg and a.png are two photos.
    return path_within(folder, derived_name(photo, ".npz"))


def write_label_map(path: Path, labels: NDArray[np.int32], *, recipe: str = "") -> None:
    """Write a label map atomically.

    Parameters
    ----------
    path : Path
        Ends in ``.npz``; its folder is created when missing.
    labels : array of shape [h, w], int32
        0 for unlabelled pixels, segment ids from 1.
    recipe : str
        Hash of the photo and the settings the label map was computed from; `read_recipe` returns it.

    Raises
    ------
    MaskError
        When `labels` has another shape, another type or negative ids.
    DiskError
        When the file cannot be written.
    """
    if labels.ndim != 2 or not np.issubdtype(labels.dtype, np.integer) or (labels.size and labels.min() < 0):
        raise MaskError(
            f"A label map must have the shape [h, w] and contain integers from 0, got {labels.shape} {labels.dtype}."
        )
    header = json.dumps({"version": _VERSION, "recipe": recipe})
    with atomic_write(path) as stream:
        np.savez_compressed(stream, labels=labels.astype(np.int32), header=np.array(header))


def read_label_map(path: Path) -> NDArray[np.int32]:
    """Return a label map, array of shape [h, w], int32.

    Raises
    ------
    MaskError
        When the file is missing, damaged or not a label map.
    """
    if not path.is_file():
        raise MaskError(f"The label map {path} is missing. Run `reconstruct` again.")
    try:
        _read_header(path)
        labels: NDArray[np.int32] = read_arrays(path, _ARRAYS, advice=_ADVICE, only=frozenset({"labels"}))["labels"]
    except FormatError as error:
        raise MaskError(str(error)) from error
    if labels.size == 0 or labels.min() < 0 or labels.max() > _MAX_SEGMENTS:
        raise MaskError(f"{path} is not a label map of Gaussian Heritage. {_ADVICE}")
    return labels


def read_recipe(path: Path) -> str | None:
    """Return the recipe of the label map at `path`; None when there is no readable label map."""
    try:
        return str(_read_header(path)["recipe"]) if path.is_file() else None
    except (FormatError, MaskError):
        return None


def _read_header(path: Path) -> dict[str, Any]:
    text = str(read_arrays(path, _ARRAYS, advice=_ADVICE, only=frozenset({"header"}))["header"])
    header: dict[str, Any] = parse_json(text, {"version": int, "recipe": str}, source=str(path), advice=_ADVICE)
    if header["version"] != _VERSION:
        raise MaskError(f"{path} was written by another version of Gaussian Heritage. {_ADVICE}")
    return header
