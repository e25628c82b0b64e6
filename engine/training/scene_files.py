"""Files of a trained scene: ``scene.ply`` (standard 3DGS PLY) and ``features.npy`` (row i belongs to Gaussian i)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError, NumericalError
from ..core.files import ArraySpec, atomic_write, read_array, replace_together
from ..formats import read_ply, write_ply
from ..scene import Gaussians

SCENE_FILE = "scene.ply"
FEATURES_FILE = "features.npy"
_ADVICE = "Run `reconstruct` again."


def save_gaussians(
    folder: Path, gaussians: Gaussians, *, before_replacing: Callable[[Path], None] | None = None
) -> None:
    """Write `gaussians` to `folder`, features as float16. After a kill both files are old, or both are new.

    Parameters
    ----------
    folder : Path
        Created when missing.
    gaussians : Gaussians
        When it has no features, a ``features.npy`` of an earlier run is removed.
    before_replacing : callable, optional
        Called with the new ``scene.ply`` before it replaces an old one.

    Raises
    ------
    NumericalError
        When a value is not finite; features must be finite in float16.
    DiskError
        When the folder cannot be written.
    """
    half: NDArray[np.float16] | None = None
    if gaussians.features is not None:
        with np.errstate(over="ignore"):
            half = gaussians.features.astype(np.float16)
        if not np.isfinite(half).all():
            raise NumericalError(
                "`features` are not finite or too large for float16. Nothing was written; train again."
            )
    with replace_together(folder, optional=(FEATURES_FILE,)) as new:
        write_ply(new / SCENE_FILE, gaussians, up="z")
        if half is not None:
            with atomic_write(new / FEATURES_FILE) as stream:
                np.save(stream, half, allow_pickle=False)
        if before_replacing is not None:
            before_replacing(new / SCENE_FILE)


def load_gaussians(folder: Path) -> Gaussians:
    """Return the Gaussians that `save_gaussians` wrote to `folder`, with features as float32 or None.

    Parameters
    ----------
    folder : Path
        The project's ``gaussians`` folder.

    Raises
    ------
    FormatError
        When the scene is missing or damaged, or the features belong to another scene.
    """
    scene = folder / SCENE_FILE
    if not scene.is_file():
        raise FormatError(f"{scene} is missing. Run `reconstruct` first.")
    gaussians = read_ply(scene, advice=_ADVICE)
    path = folder / FEATURES_FILE
    if not path.is_file():
        return gaussians
    features = read_array(path, ArraySpec("float16|float32", ("n", "d"), finite=True), advice=_ADVICE)
    if len(features) != len(gaussians):
        raise FormatError(
            f"{path} has {len(features)} rows and {scene.name} {len(gaussians)} Gaussians: they do not belong "
            f"together. {_ADVICE}"
        )
    return replace(gaussians, features=features.astype(np.float32))
