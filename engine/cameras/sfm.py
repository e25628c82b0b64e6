"""Camera poses from photos alone: structure from motion with COLMAP, in this process.

The folder holds copies of the photos, a COLMAP database and the models. A run that was killed or cancelled at any
moment is continued: copies, features and matched pairs are kept, mapping starts again.

Measured on `sakharov_statue32` (32 photos of 728 x 1092, default settings): 32 of 32 placed, 6,469 points, 0.28 px,
61 s of CPU: 39 features, 2 choosing 201 of 496 pairs, 15 matching, 5 mapping (on one core); 34 s on two idle cores.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pycolmap

from ..errors import CameraError
from ..events import Emit, Metric, Progress, StopCheck, Warned, ignore_events, never_stop
from ..scene import CameraSet, PhotoSet
from .colmap_calls import threads_for_colmap, wait_for
from .features import Workshop, match_features
from .reconstruction import camera_in_photo, camera_set, points_of, viewmat_of
from .settings import CameraSettings

__all__ = ["estimate_cameras"]

_STAGE = "cameras"
_MATCHED = 0.85
_HINT = (
    "Likely causes: too few photos, too little overlap between them, plain surfaces without texture, or blur. "
    "Take more sharp photos that overlap by two thirds, walking around the object."
)


def estimate_cameras(
    photo_set: PhotoSet,
    folder: Path,
    settings: CameraSettings | None = None,
    *,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
) -> CameraSet:
    """Return a camera for every photo that could be placed, in an upright world near the origin.

    Parameters
    ----------
    photo_set : PhotoSet
        At least three photos.
    folder : Path
        Work folder of this function alone; made when missing. After success it may be deleted.
    settings : CameraSettings, optional
        How the poses are estimated.
    emit : Emit
        Gets `Progress`, a `Warned` when the photos fall into groups without a link, and `Metric` values.
    should_stop : StopCheck
        Asked five times a second; COLMAP ends within one or two seconds.

    Returns
    -------
    CameraSet
        Lens parameters in original pixels. Of several models that do not connect the one with the most photos is
        taken; the photos of the others are listed as unregistered.

    Raises
    ------
    CameraError
        With fewer than three photos, or when fewer than ``settings.min_registered`` find their place.
    PhotoError
        When a photo went away meanwhile.
    Cancelled
        When `should_stop` says so.
    DiskError
        When the folder cannot be written.

    Notes
    -----
    Up to ``exhaustive_up_to`` photos every pair is matched, above it the promising ones (`pairs.promising_pairs`).
    """
    settings = settings or CameraSettings()
    count = len(photo_set.photos)
    if count < 3:
        raise CameraError(
            f"Camera poses cannot be found from {count} photo{'s' if count != 1 else ''}: at least 3 that overlap are "
            "needed, and 20 to 60 around an object work well."
        )
    progress = _ProgressReporter(emit)
    workshop = Workshop(folder, photo_set, settings)
    match_features(workshop, report=lambda done, message: progress(_MATCHED * done, message), should_stop=should_stop)
    models = _map(workshop, progress, should_stop)
    largest = max(models, key=lambda model: (model.num_reg_images(), model.num_points3D()), default=None)
    placed = largest.num_reg_images() if largest is not None else 0
    if largest is None or placed < settings.min_registered:
        raise CameraError(f"Only {placed} of {count} photos could be placed. {_HINT}")
    _warn_of_other_models(workshop, models, largest, emit)
    result = _as_camera_set(workshop, largest)
    emit(Metric(_STAGE, "registered_photos", float(placed)))
    emit(Metric(_STAGE, "sparse_points", float(len(result.points))))
    emit(Metric(_STAGE, "reprojection_error_px", result.reprojection_error))
    progress(1.0, f"{placed} of {count} photos placed")
    return result


class _ProgressReporter:
    """Emits `Progress` when the fraction or message changes, with the time left extrapolated."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit
        self._start = time.monotonic()
        self._last: tuple[float, str] | None = None

    def __call__(self, fraction: float, message: str) -> None:
        # Counts come from a database that is being written and may be 0 for a moment.
        fraction = max(fraction, self._last[0] if self._last else 0.0)
        if self._last == (fraction, message):
            return
        self._last = (fraction, message)
        spent = time.monotonic() - self._start
        left = spent * (1.0 - fraction) / fraction if fraction > 0.05 else None
        self._emit(Progress(_STAGE, fraction, left, message))


def _map(workshop: Workshop, progress: _ProgressReporter, should_stop: StopCheck) -> list[pycolmap.Reconstruction]:
    """Return COLMAP's models, in its order."""
    settings = workshop.settings
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = settings.seed
    options.num_threads = threads_for_colmap(settings.threads)
    # The default drops models of fewer than 10 photos, which small sets never reach.
    options.min_model_size = settings.min_registered
    options.max_num_models = 10
    # COLMAP asks for 30 matches with known points to place a photo. 15, which a verified pair has too, place 64 of 66
    # photos of a skull before a dark background (30) and 15 of 16 of bananas on a carpet (8).
    options.mapper.abs_pose_min_num_inliers = 15
    # All cameras are refined together whenever the model has grown by 30 % (COLMAP: 10 %), and at the end: a fifth of
    # the time less for the same poses to 1e-6.
    options.ba_global_frames_ratio = 1.3
    options.ba_global_points_ratio = 1.3
    shutil.rmtree(workshop.sparse, ignore_errors=True)
    workshop.sparse.mkdir(parents=True)
    count = len(workshop.copies)
    placed = 0

    def started() -> None:
        nonlocal placed
        placed = 2

    def one_more() -> None:
        nonlocal placed
        placed += 1

    def report() -> None:
        done = min(placed, count)
        progress(_MATCHED + 0.99 * (1.0 - _MATCHED) * done / count, f"{done} of {count} photos placed")

    pycolmap.set_random_seed(settings.seed)
    models = wait_for(
        "placing the photos",
        lambda token: pycolmap.incremental_mapping(
            workshop.database,
            workshop.images,
            workshop.sparse,
            options,
            "",
            started,
            one_more,
            token,
        ),
        report=report,
        should_stop=should_stop,
    )
    return [models[key] for key in sorted(models)]


def _warn_of_other_models(
    workshop: Workshop, models: list[pycolmap.Reconstruction], largest: pycolmap.Reconstruction, emit: Emit
) -> None:
    kept = set(_photo_names(workshop, largest))
    others = [names for model in models if (names := sorted(set(_photo_names(workshop, model)) - kept))]
    if others:
        listed = "; ".join(", ".join(names) for names in others)
        emit(
            Warned(
                f"The photos fall into {len(others) + 1} groups that no photo connects. The largest with {len(kept)} "
                f"photos is used; left out: {listed}."
            )
        )


def _photo_names(workshop: Workshop, model: pycolmap.Reconstruction) -> list[str]:
    return [workshop.copy_of(model.image(image_id).name).photo.name for image_id in model.reg_image_ids()]


def _as_camera_set(workshop: Workshop, model: pycolmap.Reconstruction) -> CameraSet:
    cameras = []
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        photo = workshop.copy_of(image.name).photo
        cameras.append(
            camera_in_photo(photo.name, model.camera(image.camera_id), photo.width, photo.height, viewmat_of(image))
        )
    points, colors = points_of(model)
    return camera_set(
        cameras,
        (photo.name for photo in workshop.photo_set.photos),
        points,
        colors,
        reprojection_error=model.compute_mean_reprojection_error(),
        poses_given=False,
    )
