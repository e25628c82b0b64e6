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

__getattr__ = lazy_exports(__name__, __file__)
