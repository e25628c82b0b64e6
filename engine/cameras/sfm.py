"""Estimation of camera poses from photos: structure from motion with COLMAP, in this process.

The work folder contains copies of the photos, a COLMAP database and the models. A stopped run resumes: copies, features
and matched pairs are kept, and mapping starts again. See docs/design_notes/cameras.md for run times.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.errors import CameraError
from ..core.events import Emit, Metric, Progress, StopCheck, Warned, ignore_events, never_stop
from ..core.files import delete_derived
from ..scene import CameraHealth, CameraSet, PhotoSet
from .colmap import pycolmap
from .colmap_calls import lens_of, wait_for
from .evidence import Evidence, PairFit, fit_of_pairs, measure_model, panorama_gain, strong_links, turned_share
from .feature_scales import size_gap
from .features import SfmWorkspace, match_features
from .health import TURNED, judge, refuted_images
from .lens_groups import largest_model, map_with_lenses
from .lens_trials import ModelTrials
from .mirrored import mirrored_photos
from .reconstruction import camera_in_photo, camera_set, points_of, rounded, viewmat_of
from .settings import FEWEST_PHOTOS, CameraSettings
from .still_background import still_background

_STAGE = "cameras"
_MATCHED = 0.85
"""Fraction of the run time after matching."""
_MAPPED = 0.97
"""Fraction of the run time after mapping."""
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
    """Return a camera for every photo that could be placed, in the normalised world.

    Parameters
    ----------
    photo_set : PhotoSet
        At least `FEWEST_PHOTOS` photos.
    folder : Path
        Work folder for this function only, created when missing. It may be deleted after success.
    emit : Emit
        Receives `Progress`, `Metric` values, and a `Warned` when the photos form several unconnected models.
    should_stop : StopCheck
        Called five times a second; COLMAP ends within one or two seconds after it returns True.

    Returns
    -------
    CameraSet
        With lens parameters in original pixels. Of several unconnected models, the one with the most photos is
        returned; photos outside it are listed as unregistered.

    Raises
    ------
    CameraError
        With fewer than `FEWEST_PHOTOS` photos, or when fewer than ``settings.min_registered`` could be placed.
    PhotoError
        When a photo was removed or changed in the meantime.
    Cancelled
        When `should_stop` returned True.
    DiskError
        When the folder cannot be written.
    """
    settings = settings or CameraSettings()
    count = len(photo_set.photos)
    if count < FEWEST_PHOTOS:
        raise CameraError(
            f"Camera poses cannot be found from {count} photo{'s' if count != 1 else ''}: at least {FEWEST_PHOTOS} "
            "that overlap are needed, and 20 to 60 around an object work well."
        )
    progress = _ProgressReporter(emit)
    workspace = SfmWorkspace(folder, photo_set, settings)
    match_features(workspace, report=lambda done, message: progress(_MATCHED * done, message), should_stop=should_stop)
    # Threads of BLAS wait by spinning: on 16 cores the checks of 300 photos took 606 CPU s, and twice as long.
    with ThreadPoolExecutor(2, "lens trial") as beside, threadpool_limits(1, "blas"):
        result, placed = _mapped_and_checked(workspace, progress, beside, emit, should_stop)
    health = result.health
    if health is not None and health.colour != "green":
        emit(Warned(health.sentence))
    emit(Metric(_STAGE, "registered_photos", float(placed)))
    emit(Metric(_STAGE, "sparse_points", float(len(result.points))))
    emit(Metric(_STAGE, "reprojection_error_px", result.reprojection_error))
    refuted = health is not None and health.colour == "red" and len(result.cameras) == placed
    placed = len(result.cameras)
    progress(1.0, f"{placed} of {count} photos {'have cameras, which the photos refute' if refuted else 'placed'}")
    return result


def _mapped_and_checked(
    workspace: SfmWorkspace, progress: _ProgressReporter, beside: Executor, emit: Emit, should_stop: StopCheck
) -> tuple[CameraSet, int]:
    """Return the cameras of the largest model, and the number of photos that it places."""
    count, least = len(workspace.copies), workspace.settings.min_registered

    def map_photos(where: SfmWorkspace, names: Sequence[str], should_stop: StopCheck) -> list[pycolmap.Reconstruction]:
        # What is mapped beside all photos is not told.
        return _map(where, names, progress if where is workspace else _ProgressReporter(ignore_events), should_stop)

    models, trials = map_with_lenses(workspace, map_photos, beside=beside, should_stop=should_stop)
    largest = largest_model(models)
    placed = largest.num_reg_images() if largest is not None else 0
    still = still_background(workspace) if placed < count else None
    if largest is None or placed < least:
        cause = _cause(workspace, should_stop) if still is None else still.sentence
        raise CameraError(f"Only {placed} of {count} photos could be placed. {cause}")
    if still is not None:
        emit(Warned(f"Only {placed} of {count} photos could be placed. {still.sentence}"))
    _warn_of_other_models(workspace, models, largest, emit)
    progress(_MAPPED, "checking the cameras")
    return _as_camera_set(workspace, largest, _check(workspace, models, largest, trials, should_stop)), placed


class _ProgressReporter:
    """Emits `Progress` when the fraction or message changes, with an extrapolated remaining time."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit
        self._start = time.monotonic()
        self._last: tuple[float, str] | None = None

    def __call__(self, fraction: float, message: str) -> None:
        # Counts come from a database during its writing and may be 0 for a moment.
        fraction = max(fraction, self._last[0] if self._last else 0.0)
        if self._last == (fraction, message):
            return
        self._last = (fraction, message)
        spent = time.monotonic() - self._start
        left = spent * (1.0 - fraction) / fraction if fraction > 0.05 else None
        self._emit(Progress(_STAGE, fraction, left, message))


def _map(
    workspace: SfmWorkspace, names: Sequence[str], progress: _ProgressReporter, should_stop: StopCheck
) -> list[pycolmap.Reconstruction]:
    """Return the models that COLMAP maps of the photos of these names, of all without names, in its order."""
    settings = workspace.settings
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = settings.seed
    # With several threads, the first that finds a pair to begin with wins, so poses would differ between runs. One
    # thread takes no longer: see docs/design_notes/cameras.md.
    options.num_threads = 1
    # COLMAP's default discards models of fewer than 10 photos.
    options.min_model_size = settings.min_registered
    options.max_num_models = 10
    # Matches with known points required to place a photo. COLMAP's 30 place far fewer photos of difficult scenes; a
    # verified pair has at least 15. See docs/design_notes/cameras.md.
    options.mapper.abs_pose_min_num_inliers = 15
    # Refine all cameras when the model has grown by 30 % (COLMAP: 10 %), and at the end: the same poses in less time.
    options.ba_global_frames_ratio = 1.3
    options.ba_global_points_ratio = 1.3
    options.image_names = list(names)
    delete_derived(workspace.sparse.parent, workspace.sparse.name)
    workspace.sparse.mkdir(parents=True)
    count = len(names) or len(workspace.copies)
    placed = 0

    def on_initial_pair() -> None:
        nonlocal placed
        placed = 2

    def on_next_photo() -> None:
        nonlocal placed
        placed += 1

    def report() -> None:
        n_placed = min(placed, count)
        progress(_MATCHED + (_MAPPED - _MATCHED) * n_placed / count, f"{n_placed} of {count} photos placed")

    pycolmap.set_random_seed(settings.seed)
    models = wait_for(
        "placing the photos",
        lambda token: pycolmap.incremental_mapping(
            workspace.database,
            workspace.images,
            workspace.sparse,
            options,
            "",
            on_initial_pair,
            on_next_photo,
            token,
        ),
        report=report,
        should_stop=should_stop,
    )
    return [models[key] for key in sorted(models)]


def _warn_of_other_models(
    workspace: SfmWorkspace, models: list[pycolmap.Reconstruction], largest: pycolmap.Reconstruction, emit: Emit
) -> None:
    kept = set(_photo_names(workspace, largest))
    if text := other_groups_text(len(kept), [set(_photo_names(workspace, model)) - kept for model in models]):
        emit(Warned(text))


def other_groups_text(n_kept: int, others: Iterable[Collection[str]]) -> str:
    """Return which photos lie in groups that no photo connects with those used, and what to do; empty without any.

    Parameters
    ----------
    n_kept : int
        Number of the photos that are used.
    others : iterable of collections of str
        Names of the photos of each other group. A photo of several groups counts for the largest.
    """
    named: set[str] = set()
    listed: list[str] = []
    for group in sorted(others, key=lambda names: (-len(names), sorted(names))):
        if own := sorted(set(group) - named):
            named.update(own)
            size = f"{len(own)} photo{'s' if len(own) != 1 else ''}"
            listed.append(f"group {len(listed) + 2} ({size}): {', '.join(own)}")
    if not listed:
        return ""
    return (
        f"The photos fall into {len(listed) + 1} groups that no photo connects, and the largest with {n_kept} photos "
        "is used: put the photos of each other group into a folder of its own and make a project of it, or add photos "
        f"that show a part of two groups; {'; '.join(listed)}."
    )


def _photo_names(workspace: SfmWorkspace, model: pycolmap.Reconstruction) -> list[str]:
    return [workspace.copy_of(model.image(image_id).name).photo.name for image_id in model.reg_image_ids()]


def _cause(workspace: SfmWorkspace, should_stop: StopCheck) -> str:
    """Return why hardly a photo could be placed, and what to do."""
    if mirrored := _mirrored(workspace, should_stop):
        return f"Photos are mirror images of the others ({', '.join(mirrored)}): flip them back."
    if turned_share(workspace.database) >= TURNED:
        return (
            "The photos were taken from one place, with the camera turned, so no distances can be found: walk around "
            "the object."
        )
    return _HINT


def _mirrored(workspace: SfmWorkspace, should_stop: StopCheck) -> tuple[str, ...]:
    names = [copy.name for copy in workspace.copies]
    found = mirrored_photos(workspace.database, names, should_stop=should_stop)
    return tuple(workspace.copy_of(name).photo.name for name in found)


def _check(
    workspace: SfmWorkspace,
    models: list[pycolmap.Reconstruction],
    model: pycolmap.Reconstruction,
    trials: ModelTrials | None,
    should_stop: StopCheck,
) -> CameraHealth:
    """Return what the photos say against the cameras of `model`."""
    pairs: tuple[PairFit, ...] = fit_of_pairs(model, workspace.database)
    kept = set(_photo_names(workspace, model))
    lenses = {image_id: lens_of(model, image_id) for image_id in model.reg_image_ids()}
    evidence = Evidence(
        n_photos=len(workspace.copies),
        n_placed=model.num_reg_images(),
        error=model.compute_mean_reprojection_error(),
        pairs=pairs,
        turned=turned_share(workspace.database),
        panorama_gain=panorama_gain(workspace.database, lenses),
        n_groups=len({model.image(image_id).name.split("/")[0] for image_id in model.reg_image_ids()}),
        size_gap=size_gap(workspace.database),
        links=strong_links(model, workspace.database),
        other_models=tuple(tuple(sorted(set(_photo_names(workspace, other)) - kept)) for other in models),
        mirrored=(mirrored := _mirrored(workspace, should_stop)),
        mirrored_placed=tuple(name for name in mirrored if name in kept),
        **measure_model(model, trials, should_stop=should_stop),  # type: ignore[arg-type]
    )
    refuted = [workspace.copy_of(model.image(image_id).name).photo.name for image_id in refuted_images(pairs)]
    return judge(evidence, refuted=sorted(refuted))


def _as_camera_set(workspace: SfmWorkspace, model: pycolmap.Reconstruction, health: CameraHealth) -> CameraSet:
    """Return the cameras of `model` without the photos whose place is refuted, if others stay."""
    left_out = set(health.refuted)
    if model.num_reg_images() - len(left_out) < workspace.settings.min_registered:
        left_out = set()
    cameras = []
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        photo = workspace.copy_of(image.name).photo
        if photo.name in left_out:
            continue
        cameras.append(
            camera_in_photo(photo.name, lens_of(model, image_id), photo.width, photo.height, viewmat_of(image))
        )
    points, colors = points_of(model)
    return rounded(
        camera_set(
            cameras,
            (photo.name for photo in workspace.photo_set.photos),
            points,
            colors,
            reprojection_error=model.compute_mean_reprojection_error(),
            poses_given=False,
            health=health,
        )
    )
