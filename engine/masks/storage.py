"""Label maps on disk: ``masks/<photo name>.npz``, in the same sub-folders as the photos."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, MaskError
from ..files import ArraySpec, atomic_write, parse_json, path_within, read_arrays

__all__ = ["label_map_path", "read_label_map", "read_recipe", "read_segments", "write_label_map"]

_VERSION = 1
_ARRAYS = {"labels": ArraySpec("int32", ("h", "w")), "header": ArraySpec("str", ())}
_ODDS = {"odds": ArraySpec("float32", ("n",), finite=True)}
_ADVICE = "Delete it and run `reconstruct` again."
_MAX_SEGMENTS = 1 << 20
"""Largest segment id. Segments are counted in arrays of this length; a photo has at most some hundred."""


def label_map_path(folder: Path, photo: str) -> Path:
    """Return the path of the label map of the photo called `photo` in the masks folder `folder`."""
    # The photo's suffix is kept, because a.jpg and a.png are two photos.
    return path_within(folder, photo + ".npz")


def write_label_map(
    path: Path, labels: NDArray[np.int32], odds: NDArray[np.float32] | None = None, *, recipe: str = ""
) -> None:
    """Write a label map atomically.

    Parameters
    ----------
    path : Path
        Ends in ``.npz``; its folder is created when missing.
    labels : array of shape [h, w], int32
        0 for unlabelled pixels, segment ids from 1.
    odds : array of shape [n], float32, optional
        Log-odds of the segments 1 to n of showing one whole thing (`engine.masks.wholeness`).
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
        arrays: dict[str, Any] = {"labels": labels.astype(np.int32), "header": np.array(header)}
        if odds is not None:
            arrays["odds"] = odds.astype(np.float32)
        np.savez_compressed(stream, **arrays)


def read_label_map(path: Path) -> NDArray[np.int32]:
    """Return a label map, array of shape [h, w], int32.

    Raises
    ------
    MaskError
        When the file is missing, damaged or not a label map.
    """
    return _read(path)[0]


def read_segments(
    folder: Path, photos: Iterable[str]
) -> tuple[dict[str, NDArray[np.int32]], dict[str, NDArray[np.float32]]]:
    """Return the label maps in a masks folder, and the log-odds of their segments of showing one whole thing.

    Parameters
    ----------
    folder : Path
    photos : iterable of str
        Names of photos; those without a label map are left out.

    Returns
    -------
    dict of str to array of shape [h, w], int32
        Label maps by photo.
    dict of str to array of shape [n], float32
        The log-odds of the segments 1 to n by photo. Label maps of release 0.1 have none and are left out.

    Raises
    ------
    MaskError
        When a file is damaged or not a label map.
    """
    files = {photo: label_map_path(folder, photo) for photo in photos}
    read = {photo: _read(file) for photo, file in files.items() if file.is_file()}
    odds = {photo: odds for photo, (_, odds) in read.items() if odds is not None}
    return {photo: labels for photo, (labels, _) in read.items()}, odds


def _read(path: Path) -> tuple[NDArray[np.int32], NDArray[np.float32] | None]:
    """Return label map and log-odds of segments of a file; errors are those of `read_label_map`."""
    if not path.is_file():
        raise MaskError(f"The label map {path} is missing. Run `reconstruct` again.")
    try:
        _read_header(path)
        wanted = frozenset({"labels", "odds"})
        arrays = read_arrays(path, _ARRAYS, advice=_ADVICE, optional=_ODDS, only=wanted)
    except FormatError as error:
        raise MaskError(str(error)) from error
    labels, odds = arrays["labels"], arrays.get("odds")
    in_range = labels.size > 0 and labels.min() >= 0 and labels.max() <= _MAX_SEGMENTS
    if not in_range or (odds is not None and len(odds) != labels.max()):
        raise MaskError(f"{path} is not a label map of Gaussian Heritage. {_ADVICE}")
    return labels, odds


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
