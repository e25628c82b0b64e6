"""Label maps on disk: ``masks/<photo name>.npz``, in the same sub-folders as the photos."""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import MaskError
from ..files import atomic_write, path_within

__all__ = ["label_map_path", "read_label_map", "read_recipe", "write_label_map"]

_VERSION = 1


def label_map_path(folder: Path, photo: str) -> Path:
    """Return the path of the label map of the photo called `photo` in the masks folder `folder`."""
    # The photo's suffix is kept, because a.jpg and a.png are two photos.
    return path_within(folder, photo + ".npz")


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
    labels, _ = _read(path, wanted="labels")
    if labels.ndim != 2 or labels.dtype != np.int32:
        raise MaskError(f"{path} is not a label map of Gaussian Heritage. Delete it and run again.")
    return labels


def read_recipe(path: Path) -> str | None:
    """Return the recipe of the label map at `path`; None when there is no readable label map."""
    if not path.is_file():
        return None
    try:
        _, header = _read(path, wanted="header")
    except MaskError:
        return None
    return str(header.get("recipe", ""))


def _read(path: Path, *, wanted: str) -> tuple[NDArray[np.int32], dict[str, object]]:
    """Return labels and header; the labels are only read when `wanted` is ``"labels"``, else they are empty."""
    try:
        # Opened here because np.load leaves the file open when it is not a zip archive.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            if header["version"] != _VERSION:
                raise MaskError(f"{path} was written by another version of Gaussian Heritage. Delete it and run again.")
            labels = archive["labels"] if wanted == "labels" else np.zeros((0, 0), np.int32)
    except FileNotFoundError as error:
        raise MaskError(f"The label map {path} is missing. Run `reconstruct` again.") from error
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise MaskError(f"The label map {path} cannot be read ({error}). Delete it and run again.") from error
    return labels, header
