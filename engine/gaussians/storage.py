"""Files of a trained scene: ``scene.ply`` (standard 3DGS PLY) and ``features.npy`` (row i belongs to Gaussian i)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import DiskError, FormatError, NumericalError
from ..files import atomic_write
from ..formats import read_ply, write_ply
from ..scene import Gaussians

__all__ = ["FEATURES_FILE", "SCENE_FILE", "load_gaussians", "save_gaussians"]

SCENE_FILE = "scene.ply"
FEATURES_FILE = "features.npy"


def save_gaussians(folder: Path, gaussians: Gaussians) -> None:
    """Write `gaussians` to `folder`, each file atomically, features as float16.

    Parameters
    ----------
    folder : Path
        Created when missing.
    gaussians : Gaussians
        When it has no features, a ``features.npy`` of an earlier run is removed.

    Raises
    ------
    NumericalError
        When a value is not finite; features must be finite in float16.
    DiskError
        When the folder cannot be written.
    """
    features = folder / FEATURES_FILE
    if gaussians.features is None:
        write_ply(folder / SCENE_FILE, gaussians)
        features.unlink(missing_ok=True)
        return
    with np.errstate(over="ignore"):
        half = gaussians.features.astype(np.float16)
    if not np.isfinite(half).all():
        raise NumericalError("`features` are not finite or too large for float16. Nothing was written; train again.")
    # A run that is killed between the two writes leaves a scene without features, never with those of another scene.
    features.unlink(missing_ok=True)
    write_ply(folder / SCENE_FILE, gaussians)
    with atomic_write(features) as stream:
        np.save(stream, half, allow_pickle=False)


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
    DiskError
        When a file cannot be read.
    """
    scene = folder / SCENE_FILE
    if not scene.is_file():
        raise FormatError(f"{scene} is missing. Run `reconstruct` first.")
    gaussians = read_ply(scene)
    path = folder / FEATURES_FILE
    if not path.is_file():
        return gaussians
    try:
        features = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise FormatError(f"{path} is not a NumPy array: {error}. Train the scene again.") from error
    except OSError as error:
        raise DiskError(f"Could not read {path}: {error.strerror or error}. Check its permissions.") from error
    if features.ndim != 2 or len(features) != len(gaussians):
        raise FormatError(
            f"{path} has shape {features.shape} and {scene.name} {len(gaussians)} Gaussians: they do not belong "
            "together. Train the scene again."
        )
    return replace(gaussians, features=features.astype(np.float32))
