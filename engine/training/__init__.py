"""Training of Gaussians and their segmentation features on photos with known cameras."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .adam import AdamState, adam_step
    from .background import background_gaussians
    from .card_settings import key_values, preset_on_card, settings_with_sizes, sizes_on_card
    from .checkpoint import CHECKPOINT_FILE, delete_old_runs, latest_run, read_progress
    from .compilation import compile_kernels
    from .coverage import WELL_SEEN, Coverage
    from .detail import train_detail
    from .detail_crops import DetailCrop, DetailPlan, tiles
    from .initialise import InitialValues, gaussians_at, gaussians_from_points, initial_features
    from .loop import train
    from .losses import Target, photometric_loss
    from .overrides import read_overrides
    from .parameters import Parameters, render
    from .quality import gaussians_so_far, measure_quality
    from .result import TrainingResult
    from .scene_files import FEATURES_FILE, SCENE_FILE, load_gaussians, save_gaussians
    from .schedule import Schedule
    from .start import start_gaussians
    from .validation import MIN_PHOTOS_TO_CHOOSE, validation_photos
    from .views import TrainingView, is_held_out, load_views

__all__ = [
    "save_gaussians",
    "load_gaussians",
    "initial_features",
    "gaussians_from_points",
    "gaussians_at",
    "InitialValues",
    "SCENE_FILE",
    "FEATURES_FILE",
    "MIN_PHOTOS_TO_CHOOSE",
    "CHECKPOINT_FILE",
    "WELL_SEEN",
    "AdamState",
    "DetailCrop",
    "DetailPlan",
    "Coverage",
    "Parameters",
    "Schedule",
    "Target",
    "TrainingResult",
    "TrainingView",
    "adam_step",
    "background_gaussians",
    "compile_kernels",
    "delete_old_runs",
    "gaussians_so_far",
    "is_held_out",
    "key_values",
    "latest_run",
    "load_views",
    "measure_quality",
    "photometric_loss",
    "preset_on_card",
    "read_overrides",
    "read_progress",
    "render",
    "settings_with_sizes",
    "sizes_on_card",
    "start_gaussians",
    "tiles",
    "train",
    "train_detail",
    "validation_photos",
]

__getattr__ = lazy_exports(__name__, __file__)
