"""The decisions of a run, made before the work: what the scene needs, what is left out, and why.

`plan_work` decides from the photos and the user's settings. `plan_scene` adds the names of the test photos and of the
photos that get masks, once the cameras are known. No decision that the trained scene depends on reads the pixels of a
test photo: their texture decides the forecast and the advice only. The plan and the report list what was left out with
the reasons.
No other module makes these decisions. Measurements behind the constants: docs/design_notes/planning.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ...cameras.settings import CameraSettings
from ...core.settings import require
from ...photos import PhotoStatistics
from ...rasterizer import PROCESSOR, Device
from ...rasterizer.settings import DeviceName
from ...scene import CameraSet, Photo, PhotoSet
from ...training import MIN_PHOTOS_TO_CHOOSE, settings_with_sizes, validation_photos
from ...training.settings import DEFAULT_PRESET, PRESETS, TrainingSettings

Pairs = Literal["none", "all", "promising"]

MIN_TEXTURE_SHARE = 0.04  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Median share of textured pixels below which structure from motion may fail."""
RECOMMENDED_PHOTOS = 12  # chosen on museum_room, sakharov_statue32
"""Number of photos below which the plan says that they are few."""
MIN_STEPS = 3000  # chosen on herz_jesus25, meeting_place9, banana16
"""Training steps that are done however few the photos: up to there the error on test photos falls."""
PAIRS_PER_PHOTO = 11.0  # chosen on museum_room, sakharov_statue32
"""Expected number of promising pairs per photo: the geometric mean of two measured photo sets."""


@dataclass(frozen=True)
class PlanSettings:
    """The user's settings for the plan of a run.

    Attributes
    ----------
    preset : str
        Name of a training preset.
    device : {"auto", "cpu", "gpu"}
        What to train on. ``auto``: the graphics card if there is one that passes its self-test.
    max_gaussians, max_side : int or None
        Settings of training on a card in place of those of the preset; None for the preset's.
    wants_objects : bool
        Whether objects are to be isolated. Without objects, no masks are made and no features are trained.
    n_mask_photos : int
        Largest number of photos that get SAM masks. Neighbouring photos show nearly the same segments.
    exclude_transients : bool
        Whether content that appears in one photo only, such as people who walk by, is excluded from training.
    overrides : dict
        Single settings of training by name, in place of what preset and plan say, see `training.read_overrides`.
    leave_out : bool
        Whether unnecessary work is left out. False is for measuring what leaving out saves and costs: masks for all
        photos, features with their loss in every step, and all bands of colour without a trial.
    """

    preset: str = DEFAULT_PRESET
    device: DeviceName = "auto"
    max_gaussians: int | None = None
    max_side: int | None = None
    wants_objects: bool = True
    n_mask_photos: int = 28  # chosen on museum_room
    exclude_transients: bool = False  # chosen on museum_room
    overrides: dict[str, Any] = field(default_factory=dict)
    leave_out: bool = True

    def __post_init__(self) -> None:
        require(self, "preset", self.preset in PRESETS, f"one of {', '.join(PRESETS)}")
        PRESETS[self.preset].changed(**self.overrides)
        require(self, "n_mask_photos", self.n_mask_photos >= 1, "at least 1")
        for name, least in (("max_gaussians", 1_000), ("max_side", 64)):
            value = getattr(self, name)
            require(self, name, value is None or value >= least, f"at least {least:,}")

    @property
    def wanted_sizes(self) -> dict[str, int]:
        """Sizes on a card that the user asked for, by the name of the setting."""
        wanted = {"max_gaussians": self.max_gaussians, "max_side": self.max_side}
        return {name: value for name, value in wanted.items() if value is not None}


@dataclass(frozen=True)
class LeftOut:
    """Work that this scene does not need.

    Attributes
    ----------
    what : str
        Name of the work, a noun phrase.
    why : str
        The reason, a clause without a full stop: it is shown behind `what` and a colon.
    """

    what: str
    why: str


@dataclass(frozen=True)
class WorkPlan:
    """Decisions that need only the photos and the settings; ``project.json`` stores them as `work_plan_as_dict` does.

    Attributes
    ----------
    preset : str
        Name of the training preset.
    n_photos : int
        Number of usable photos.
    photo_width, photo_height : int
        Size of the largest photo in pixels.
    width, height : int
        Size in pixels at which the largest photo is trained on.
    poses_given : bool
        Whether cameras are read instead of estimated. Features are then matched only if the model has no points.
    texture : float
        Median share of textured pixels in the photos, see `PhotoStatistics`.
    pairs : {"none", "all", "promising"}
        Which pairs of photos are matched.
    n_pairs : int
        Number of these pairs; an estimate for ``promising``.
    n_held_out, n_mask_photos : int
        Numbers of test photos and of photos with masks. `ScenePlan` names them.
    features, exposure : bool
        Whether segmentation features, and a brightness factor per photo, are trained.
    sh_degree, max_gaussians, steps : int
        See `TrainingSettings`.
    trial : float
        ``trial_fraction`` of `TrainingSettings`.
    clustering_interval : int
        See `TrainingSettings`.
    left_out : tuple of LeftOut
        Work that is left out, with the reasons.
    notes : tuple of str
        Advice to the user before the work starts, as sentences.
    exclude_transients : bool
        See `PlanSettings`.
    device : Device
        What is trained on.
    sizes, overrides : dict
        Settings in place of those of the preset, by name: for the device, and given by the user.
    """

    preset: str
    n_photos: int
    photo_width: int
    photo_height: int
    width: int
    height: int
    poses_given: bool
    texture: float
    pairs: Pairs
    n_pairs: int
    n_held_out: int
    n_mask_photos: int
    features: bool
    exposure: bool
    sh_degree: int
    max_gaussians: int
    steps: int
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]
    trial: float
    clustering_interval: int
    exclude_transients: bool = False
    device: Device = PROCESSOR
    sizes: dict[str, int] = field(default_factory=dict)
    overrides: dict[str, Any] = field(default_factory=dict)

    @property
    def n_training(self) -> int:
        """Number of training photos."""
        return self.n_photos - self.n_held_out


@dataclass(frozen=True)
class ScenePlan:
    """Decisions that need the cameras.

    Attributes
    ----------
    held_out : tuple of str
        Test photos, which measure the error, are never trained on and decide nothing.
    mask_photos : tuple of str
        Photos that get a SAM label map. Some of them are test photos, to evaluate the features.
    features : bool
        Whether the segmentation features are trained.
    left_out : tuple of LeftOut
        Work that is left out, with the reasons.
    """

    held_out: tuple[str, ...]
    mask_photos: tuple[str, ...]
    features: bool
    left_out: tuple[LeftOut, ...]


def evenly_spaced(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Return `count` of `names`, evenly spaced in their order, or all of them if there are fewer."""
    if len(names) <= count:
        return tuple(names)
    return tuple(names[(2 * i + 1) * len(names) // (2 * count)] for i in range(count))


def plan_work(
    photo_set: PhotoSet,
    statistics: Sequence[PhotoStatistics],
    settings: PlanSettings,
    *,
    cameras: CameraSettings,
    poses_given: bool,
    points_given: bool = False,
    choice: tuple[Device, Mapping[str, int]] = (PROCESSOR, MappingProxyType({})),
) -> WorkPlan:
    """Make the decisions that need only the photos and the settings.

    Parameters
    ----------
    photo_set : PhotoSet
        The usable photos.
    statistics : sequence of PhotoStatistics
        Of the same photos.
    cameras : CameraSettings
        States up to how many photos every pair is matched.
    poses_given, points_given : bool
        Whether the user gave camera poses, and sparse points with them.
    choice : tuple
        Result of `choose_sizes`: what is trained on, and settings in place of the preset's there.
    """
    count = len(photo_set.photos)
    n_held_out = n_test_photos(count, settings)
    device, sizes = choice
    preset = settings_with_sizes(settings.preset, sizes, count - n_held_out).changed(**settings.overrides)
    largest = largest_photo(photo_set)
    scale = min(1.0, preset.schedule.max_side / max(largest.width, largest.height))
    left_out: list[LeftOut] = []
    pairs, n_pairs = _pairs(count, cameras, points_given, left_out)
    if poses_given:
        left_out.append(LeftOut("structure from motion", "camera poses were given"))
    _lens(photo_set, poses_given, left_out)
    if not n_held_out:
        left_out.append(LeftOut("test photos", f"{count} photos are too few to exclude one from training"))
    features = settings.wants_objects or not settings.leave_out
    n_masks = _n_masks(count, settings, left_out)
    if preset.appearance.sh_degree < 3:
        left_out.append(
            LeftOut(
                f"bands of view-dependent colour above {preset.appearance.sh_degree}",
                f"the preset {settings.preset} does not use them; "
                "each band enlarges every Gaussian and slows every step",
            )
        )
    if scale < 1.0:
        left_out.append(
            LeftOut(
                f"pictures larger than {preset.schedule.max_side} pixels",
                f"the preset {settings.preset} trains on reduced photos; "
                f"their longest side has {max(largest.width, largest.height)} pixels",
            )
        )
    if device.limited:
        left_out.append(
            LeftOut(
                f"Gaussians beyond {preset.growth.max_gaussians:,}",
                f"{device.name} holds no more beside the photos",
            )
        )
    texture = float(np.median([photo.texture for photo in statistics])) if statistics else 1.0
    steps = _steps(count - n_held_out, preset, settings, left_out)
    _choose_nothing(count - n_held_out, preset, settings, left_out)
    interval = _clustering_interval(preset, settings, left_out)
    return WorkPlan(
        preset=settings.preset,
        n_photos=count,
        photo_width=largest.width,
        photo_height=largest.height,
        width=round(largest.width * scale),
        height=round(largest.height * scale),
        poses_given=poses_given,
        texture=texture,
        pairs=pairs,
        n_pairs=n_pairs,
        n_held_out=n_held_out,
        n_mask_photos=n_masks,
        features=features,
        exposure=preset.appearance.exposure,
        sh_degree=preset.appearance.sh_degree,
        max_gaussians=preset.growth.max_gaussians,
        steps=steps,
        left_out=tuple(left_out),
        notes=_notes(photo_set, texture, poses_given) + _kept_sizes(device, sizes, preset),
        trial=preset.appearance.trial_fraction if settings.leave_out else 0.0,
        clustering_interval=interval,
        exclude_transients=settings.exclude_transients,
        device=device,
        sizes=dict(sizes),
        overrides=settings.overrides,
    )


def largest_photo(photo_set: PhotoSet) -> Photo:
    """Return the photo with the most pixels."""
    return max(photo_set.photos, key=lambda photo: photo.width * photo.height)


def n_test_photos(count: int, settings: PlanSettings | WorkPlan) -> int:
    """Return how many of `count` photos are test photos."""
    every = _held_out_every(settings)
    return len(range(every // 2, count, every)) if every else 0


def _held_out_every(settings: PlanSettings | WorkPlan) -> int:
    return PRESETS[settings.preset].changed(**settings.overrides).measurement.held_out_every


def _kept_sizes(device: Device, sizes: Mapping[str, int], preset: TrainingSettings) -> tuple[str, ...]:
    """Return a sentence about sizes that an earlier run chose for another device; nothing for present ones."""
    if not device.kept:
        return ()
    return (
        f"The training of this project was begun on {'a graphics card' if sizes else 'the processor'} and keeps "
        f"its sizes: at most {preset.growth.max_gaussians:,} Gaussians, pictures of {preset.schedule.max_side} pixels. "
        "Choose another preset or a new folder for those of this device.",
    )


def steps_for(preset: TrainingSettings, n_trained: int) -> int:
    """Return the steps for so many training photos: `ScheduleSettings.rounds` through them, at least `MIN_STEPS`."""
    schedule = preset.schedule
    return min(schedule.steps, max(MIN_STEPS, schedule.rounds * n_trained)) if schedule.rounds else schedule.steps


def _steps(n_trained: int, preset: TrainingSettings, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    """Return the number of steps, `steps_for` the photos where anything may be left out."""
    if not settings.leave_out or "steps" in settings.overrides:
        return preset.schedule.steps
    steps = steps_for(preset, n_trained)
    if steps < preset.schedule.steps:
        left_out.append(
            LeftOut(
                f"{preset.schedule.steps - steps:,} of {preset.schedule.steps:,} training steps",
                f"more steps would overfit {n_trained} photos; "
                f"each is already used {steps / max(1, n_trained):.0f} times",
            )
        )
    return steps


def _clustering_interval(preset: TrainingSettings, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    """Return the number of steps between two evaluations of the segmentation loss."""
    if not settings.leave_out:
        return 1
    interval = preset.features.clustering_interval
    if settings.wants_objects and interval > 1:
        left_out.append(
            LeftOut(
                f"the loss of the segmentation features in {interval - 1} of {interval} steps",
                "the features converge with fewer evaluations of their loss",
            )
        )
    return interval


def _pairs(count: int, cameras: CameraSettings, points_given: bool, left_out: list[LeftOut]) -> tuple[Pairs, int]:
    """Return which pairs of photos are matched, and how many."""
    every = count * (count - 1) // 2
    if points_given:
        return "none", 0
    if count <= cameras.exhaustive_up_to:
        return "all", every
    expected = min(every, round(PAIRS_PER_PHOTO * count))
    if expected < every:
        left_out.append(
            LeftOut(
                f"full matching of about {every - expected} of {every} pairs of photos",
                "a quick comparison of their largest features selects the pairs that show the same place",
            )
        )
    return "promising", expected


def _lens(photo_set: PhotoSet, poses_given: bool, left_out: list[LeftOut]) -> None:
    """Add the lens model per photo to `left_out` if all photos were taken with one lens."""
    shared = len({(photo.width, photo.height, photo.focal_px) for photo in photo_set.photos}) == 1
    if shared and not poses_given:
        left_out.append(
            LeftOut("a lens model per photo", "all photos have the same size and focal length and share one lens model")
        )


def _n_masks(count: int, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    """Return the number of photos that get masks."""
    if not settings.leave_out:
        return count
    if not settings.wants_objects:
        left_out.append(LeftOut("masks and segmentation features", "no objects were requested (--no-objects)"))
        return 0
    wanted = min(count, settings.n_mask_photos)
    if wanted < count:
        left_out.append(
            LeftOut(
                f"masks for {count - wanted} of {count} photos",
                f"{wanted} evenly spaced photos show every segment several times; "
                "each additional photo takes seconds and shows nothing new",
            )
        )
    return wanted


def _choose_nothing(n_trained: int, preset: TrainingSettings, settings: PlanSettings, left_out: list[LeftOut]) -> None:
    """Add to `left_out` that nothing is decided during training, where there are too few photos to decide on."""
    tries = settings.leave_out and preset.appearance.trial_fraction > 0 and preset.appearance.sh_degree > 0
    if tries and not validation_photos(n_trained):
        left_out.append(
            LeftOut(
                "trials during training",
                f"{n_trained} training photos are too few to keep some of them for decisions; "
                f"{MIN_PHOTOS_TO_CHOOSE} are needed",
            )
        )


def _notes(photo_set: PhotoSet, texture: float, poses_given: bool) -> tuple[str, ...]:
    """Return advice to the user about the photos, as sentences."""
    notes = []
    count = len(photo_set.photos)
    if photo_set.rejected:
        notes.append(f"{len(photo_set.rejected)} files are not used; the report lists them with the reasons.")
    if count < RECOMMENDED_PHOTOS:
        notes.append(f"{count} photos are few; 20 to 60 around an object work well.")
    if texture < MIN_TEXTURE_SHARE and not poses_given:
        notes.append(
            f"The photos show little texture ({texture:.0%} of their pixels), so their cameras may not be found. "
            "Photograph the object with its surroundings."
        )
    without = sum(photo.focal_px is None for photo in photo_set.photos)
    if without and not poses_given:
        notes.append(f"{without} photos do not state their focal length; it is estimated.")
    return tuple(notes)


def training_settings(work: WorkPlan) -> TrainingSettings:
    """Return the settings of the plan's preset, changed by the plan's decisions."""
    preset = settings_with_sizes(work.preset, work.sizes, work.n_training).changed(**work.overrides)
    # A loss that is evaluated more often has a smaller weight in each evaluation.
    share = work.clustering_interval / preset.features.clustering_interval
    planned = preset.with_steps(work.steps).changed(
        clustering_interval=work.clustering_interval,
        lambda_clustering=preset.features.lambda_clustering * share,
        lambda_ray=preset.features.lambda_ray * share,
        train_features=work.features,
        transients=work.exclude_transients,
        trial_fraction=work.trial,
    )
    return planned.changed(**work.overrides)


def work_plan_as_dict(work: WorkPlan) -> dict[str, Any]:
    """Return the plan as JSON values, as ``project.json`` and events have them."""
    return asdict(work)


def plan_scene(work: WorkPlan, camera_set: CameraSet) -> ScenePlan:
    """Name the test photos and the photos that get masks, among the photos with a camera."""
    names = [camera.photo for camera in camera_set.cameras]
    held_out, mask_photos = choose_photos(work, names)
    left_out = work.left_out
    if work.n_held_out and not held_out:
        left_out += (
            LeftOut("test photos", f"only {len(names)} photos could be placed, too few to exclude one from training"),
        )
    return ScenePlan(held_out, mask_photos, work.features, left_out)


def choose_photos(work: WorkPlan, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the test photos and the photos that get masks among `names`, the photos with a camera in sorted order."""
    every = _held_out_every(work)
    held_out = tuple(names[every // 2 :: every]) if every else ()
    wanted = min(work.n_mask_photos, len(names))
    if wanted in (0, len(names)):
        return held_out, tuple(sorted(names[:wanted]))
    evaluated = evenly_spaced(held_out, max(1, wanted // 6)) if held_out else ()
    trained = evenly_spaced([name for name in names if name not in held_out], wanted - len(evaluated))
    return held_out, tuple(sorted({*evaluated, *trained}))
