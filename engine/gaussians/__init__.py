"""Initial Gaussians for training, and the files of a trained scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .initialise import InitialValues, gaussians_at, gaussians_from_points, initial_features
    from .storage import FEATURES_FILE, SCENE_FILE, load_features, load_gaussians, save_gaussians

__all__ = [
    "FEATURES_FILE",
    "SCENE_FILE",
    "InitialValues",
    "gaussians_at",
    "gaussians_from_points",
    "initial_features",
    "load_features",
    "load_gaussians",
    "save_gaussians",
]

__getattr__ = lazy_exports(__name__, __file__)
