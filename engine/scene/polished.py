"""Polished Gaussians of an object and their file in the object's folder. NumPy only, because the add-on reads them."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..files import atomic_write, object_file
from .gaussians import Gaussians

__all__ = ["Polished", "forget_polished", "load_polished", "save_polished"]

_POLISHED = "polished.npz"
_ROWS, _TRAINED_MEANS = "rows", "trained_means"
_VALUES = tuple(field.name for field in fields(Gaussians) if field.name != "features")


@dataclass(frozen=True)
class Polished:
    """An object's Gaussians after `engine.objects.polishing.polish`.

    Attributes
    ----------
    rows : array of shape [M], int32
        Indices of the object's Gaussians in the scene, ascending.
    trained_means : array of shape [M, 3], float32
        Their centres before polishing, in world units.
    gaussians : Gaussians
        The M polished Gaussians, without features.
    """

    rows: NDArray[np.int32]
    trained_means: NDArray[np.float32]
    gaussians: Gaussians

    def with_polished(self, gaussians: Gaussians, rows: NDArray[np.integer]) -> Gaussians:
        """Return `gaussians`, which are `rows` [K] of the scene, with the polished ones replaced.

        A Gaussian whose centre differs from its trained one was moved by the user and is not replaced.
        """
        if len(self.rows) == 0:
            return gaussians
        place = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        unmoved = (self.rows[place] == rows) & (self.trained_means[place] == gaussians.means).all(axis=1)
        replaced = {}
        for name in _VALUES:
            values = getattr(gaussians, name).copy()
            values[unmoved] = getattr(self.gaussians, name)[place[unmoved]]
            replaced[name] = values
        return replace(gaussians, **replaced)


def save_polished(folder: Path, polished: Polished) -> None:
    """Write `polished` to an object's folder.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    arrays: dict[str, Any] = {name: getattr(polished.gaussians, name) for name in _VALUES}
    arrays |= {_ROWS: polished.rows, _TRAINED_MEANS: polished.trained_means}
    with atomic_write(folder / _POLISHED) as stream:
        np.savez(stream, **arrays)


def forget_polished(folder: Path) -> None:
    """Remove the polished Gaussians from an object's folder, if it has any."""
    (folder / _POLISHED).unlink(missing_ok=True)


def load_polished(project: Path, object_id: str) -> Polished | None:
    """Return the polished Gaussians of an object, None when it was not polished.

    Raises
    ------
    FormatError
        When the file is damaged.
    """
    file = object_file(project, object_id, _POLISHED)
    if not file.is_file():
        return None
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            values = {name: np.asarray(archive[name], np.float32) for name in _VALUES}
            rows = np.asarray(archive[_ROWS], np.int32)
            trained_means = np.asarray(archive[_TRAINED_MEANS], np.float32)
        count, n_sh = rows.shape[0], values["sh"].shape[1]
        shapes = {"means": (3,), "log_scales": (3,), "quats": (4,), "opacity_logits": (), "sh": (n_sh, 3)}
        arrays = {**values, _TRAINED_MEANS: trained_means, _ROWS: rows}
        expected = {**shapes, _TRAINED_MEANS: (3,), _ROWS: ()}
        wrong = [name for name, array in arrays.items() if array.shape != (count, *expected[name])]
        if wrong:
            raise ValueError(f"{', '.join(wrong)} has an unexpected shape")
    # NumPy raises RuntimeError for a broken zip header and TypeError for a file that is no archive.
    except (OSError, ValueError, KeyError, IndexError, TypeError, RuntimeError, EOFError, zipfile.BadZipFile) as error:
        raise FormatError(f"{file} cannot be read: {error}. Isolate the object again.") from error
    return Polished(rows, trained_means, Gaussians(**values))
