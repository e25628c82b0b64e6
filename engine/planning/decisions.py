"""What this scene needs: decided from the photos, the cameras and what the person wants, before the work.

`plan_work` decides what the photos alone tell; `plan_scene` adds the names once the cameras are known. What is left out
is listed with the reason; the report repeats it. This is the only place that decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..cameras.settings import CameraSettings
from ..photos import PhotoLook
from ..scene import CameraSet, PhotoSet
from ..settings import require
from ..training.settings import PRESETS, TrainingSettings

__all__ = ["LeftOut", "PlanSettings", "ScenePlan", "WorkPlan", "plan_scene", "plan_work", "spread", "training_settings"]

Pairs = Literal["none", "all", "promising"]

EXIF_RANGE = 0.5
"""Stops between the extreme exposures of a set above which its camera was on automatic. Three real sets: 0.0 twice
(manual), 1.0 once (a statue). There the correction lowered the held-out L1 error of two runs by 2.5 and 1.2 %, and
PSNR rose by 0.12 dB in one (preview) and fell by 0.13 dB in the other (half of standard): no clear gain yet."""
BRIGHTNESS_SPREAD = 0.75
"""Standard deviation of the brightness in stops above which exposures are taken to differ where EXIF does not say.
What the photos show makes up to 0.47 at one exposure (a skull before black, measured), so this must be well above.
Only where no trial can tell: a room whose photos differ by a tenth of a stop ended at 29.69 dB with the correction, at
29.30 without."""
MOST_FOR_A_TRIAL = 0.1
"""Part of the steps that a trial may take, with and without; in `preview` it would take a quarter."""
LITTLE_TEXTURE = 0.04
"""Median share of textured pixels below which cameras may not be found. A skull before a black cloth, whose photos
can be placed, stands at 0.11; other real sets at 0.5."""
FEW_PHOTOS = 12
FEWEST_STEPS = 1500
"""Steps in which Gaussians come to their number and place, however few the photos. 14 photos of a fruit bowl in `best`:
23.7 dB after at most 900 steps, 24.9 of 1,500, and 23.1 of 6,000, by then true of the photos trained on only."""
EXPECTED_PAIRS_A_PHOTO = 11.0
"""Geometric mean of two measured sets: 201 promising pairs of 32 photos of a statue (6.3 a photo), 908 of 48 photos of
a room, which see each other's walls (18.9)."""


@dataclass(frozen=True)
class PlanSettings:
    """What the person wants of this run.

    Attributes
    ----------
    preset : str
        Name of a training preset.
    wants_objects : bool
        Whether objects are to be isolated; without, no masks are made and no features trained.
    n_mask_photos : int
        Photos that get SAM masks, at most; neighbouring photos show nearly the same segments.
    passers_by : bool
        Whether people walk through some of the photos: what stands in one photo only is left out then.
    leave_out : bool
        False does everything, to measure what leaving out saves and costs: masks of all photos, features and in every
        step, exposure correction and all bands of colour without a trial, every step.
    """

    preset: str = "standard"
    wants_objects: bool = True
    n_mask_photos: int = 28
    passers_by: bool = False
    leave_out: bool = True

    def __post_init__(self) -> None:
        require(self, "preset", self.preset in PRESETS, f"one of {', '.join(PRESETS)}")
        require(self, "n_mask_photos", self.n_mask_photos >= 1, "at least 1")


@dataclass(frozen=True)
class LeftOut:
    """Something this scene does not need."""

    what: str
    why: str


@dataclass(frozen=True)
class WorkPlan:
    """Decisions before any work.

    Attributes
    ----------
    preset : str
    n_photos : int
        Usable ones.
    photo_width, photo_height : int
        Of the largest photo, pixels.
    width, height : int
        Of the training pictures of that photo, pixels.
    poses_given : bool
        Then cameras are read; features are matched only where the model has no points.
    texture : float
        Median share of the photos' pixels that show texture, see `PhotoLook`.
    pairs : {"none", "all", "promising"}
        Which pairs of photos are matched.
    n_pairs : int
        How many that is; for ``promising`` an expectation.
    n_held_out, n_mask_photos : int
        Numbers of photos; their names are known once the cameras are.
    features, exposure : bool
        Whether segmentation features, and a brightness factor per photo, are trained.
    passers_by : bool
        Whether what stands in one photo only is left out of it.
    sh_degree, max_gaussians, steps : int
        See `TrainingSettings`.
    stop_when_flat, trial : float
        See `TrainingSettings`.
    clustering_interval : int
        See `TrainingSettings`.
    left_out : tuple of LeftOut
    notes : tuple of str
        What the person should know before starting.
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
    stop_when_flat: float
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]
    trial: float
    clustering_interval: int
    passers_by: bool = False


@dataclass(frozen=True)
class ScenePlan:
    """Decisions for the stages after the cameras.

    Attributes
    ----------
    held_out : tuple of str
        Photos that measure the error and are never trained on.
    mask_photos : tuple of str
        Photos that get a SAM label map; some of them held out, to judge the features.
    features : bool
        Whether the 16-d segmentation feature is trained.
    left_out : tuple of LeftOut
    """

    held_out: tuple[str, ...]
    mask_photos: tuple[str, ...]
    features: bool
    left_out: tuple[LeftOut, ...]


def spread(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Return `count` of `names`, evenly spread over their order; all of them when there are fewer."""
    if len(names) <= count:
        return tuple(names)
    return tuple(names[(2 * i + 1) * len(names) // (2 * count)] for i in range(count))


def plan_work(
    photo_set: PhotoSet,
    looks: Sequence[PhotoLook],
    settings: PlanSettings,
    *,
    cameras: CameraSettings,
    poses_given: bool,
    points_given: bool = False,
) -> WorkPlan:
    """Decide what can be decided from the photos.

    Parameters
    ----------
    photo_set : PhotoSet
        The usable photos.
    looks : sequence of PhotoLook
        Of the same photos.
    settings : PlanSettings
    cameras : CameraSettings
        Says from how many photos on pairs are chosen.
    poses_given, points_given : bool
        Whether the person gave camera poses, and sparse points with them.
    """
    preset, count = PRESETS[settings.preset], len(photo_set.photos)
    largest = max(photo_set.photos, key=lambda photo: photo.width * photo.height)
    scale = min(1.0, preset.max_side / max(largest.width, largest.height))
    left_out: list[LeftOut] = []
    pairs, n_pairs = _pairs(count, cameras, points_given, left_out)
    if poses_given:
        left_out.append(LeftOut("structure from motion", "camera poses were given"))
    _lens(photo_set, poses_given, left_out)
    n_held_out = len(range(preset.held_out_every // 2, count, preset.held_out_every)) if preset.held_out_every else 0
    if not n_held_out:
        left_out.append(LeftOut("held-out photos", f"{count} photos are too few to spare one"))
    features = settings.wants_objects or not settings.leave_out
    n_masks = _n_masks(count, settings, left_out)
    if preset.sh_degree < 3:
        left_out.append(
            LeftOut(
                f"bands of view-dependent colour above {preset.sh_degree}",
                f"the preset {settings.preset} has none: each band makes every Gaussian larger and every step slower",
            )
        )
    if scale < 1.0:
        left_out.append(
            LeftOut(
                f"pixels beyond {preset.max_side} on the longest side",
                f"the preset {settings.preset} trains on smaller pictures; "
                f"the photos have {max(largest.width, largest.height)}",
            )
        )
    texture = float(np.median([look.texture for look in looks])) if looks else 1.0
    steps = _steps(count - n_held_out, preset, settings, left_out)
    flat = preset.stop_when_flat if settings.leave_out and n_held_out else 0.0
    exposure = _exposure(looks, settings, _can_try(replace(preset, steps=steps), count, n_held_out), left_out)
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
        exposure=exposure,
        sh_degree=preset.sh_degree,
        max_gaussians=preset.max_gaussians,
        steps=steps,
        stop_when_flat=flat,
        left_out=tuple(left_out),
        notes=_notes(photo_set, texture, poses_given),
        trial=preset.trial if settings.leave_out else 0.0,
        clustering_interval=interval,
        passers_by=settings.passers_by,
    )


def _steps(n_trained: int, preset: TrainingSettings, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    """Return the steps worth doing: `TrainingSettings.rounds` through the photos, at least `FEWEST_STEPS`."""
    if not preset.rounds or not settings.leave_out:
        return preset.steps
    steps = min(preset.steps, max(FEWEST_STEPS, preset.rounds * n_trained))
    if steps < preset.steps:
        left_out.append(
            LeftOut(
                f"{preset.steps - steps:,} of {preset.steps:,} training steps",
                f"{n_trained} photos hold no more: each is trained on {steps / max(1, n_trained):.0f} times",
            )
        )
    return steps


def _clustering_interval(preset: TrainingSettings, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    if not settings.leave_out:
        return 1
    interval = preset.clustering_interval
    if settings.wants_objects and interval > 1:
        left_out.append(
            LeftOut(
                f"segmentation features in {interval - 1} of {interval} steps",
                "they settle with fewer: their share of the loss is taken every so many steps instead of in each",
            )
        )
    return interval


def _pairs(count: int, cameras: CameraSettings, points_given: bool, left_out: list[LeftOut]) -> tuple[Pairs, int]:
    every = count * (count - 1) // 2
    if points_given:
        return "none", 0
    if count <= cameras.exhaustive_up_to:
        return "all", every
    expected = min(every, round(EXPECTED_PAIRS_A_PHOTO * count))
    if expected < every:
        left_out.append(
            LeftOut(
                f"matching about {every - expected} of {every} pairs of photos in full",
                "a quick look at their largest features finds the pairs that show the same place",
            )
        )
    return "promising", expected


def _lens(photo_set: PhotoSet, poses_given: bool, left_out: list[LeftOut]) -> None:
    one = len({(photo.width, photo.height, photo.focal_px) for photo in photo_set.photos}) == 1
    if one and not poses_given:
        left_out.append(
            LeftOut("a lens model per photo", "all photos have one size and focal length: one lens is shared")
        )


def _n_masks(count: int, settings: PlanSettings, left_out: list[LeftOut]) -> int:
    if not settings.leave_out:
        return count
    if not settings.wants_objects:
        left_out.append(LeftOut("masks and segmentation features", "no objects were asked for (--no-objects)"))
        return 0
    wanted = min(count, settings.n_mask_photos)
    if wanted < count:
        left_out.append(
            LeftOut(
                f"masks of {count - wanted} of {count} photos",
                f"{wanted} evenly spread photos show every segment several times; "
                "each further one costs seconds and shows it again",
            )
        )
    return wanted


def _can_try(training: TrainingSettings, count: int, n_held_out: int) -> bool:
    """Whether a trial can tell what pays, and takes little of the time."""
    n_steps = training.trial_steps(count - n_held_out) if n_held_out else 0
    return 0 < 2 * n_steps <= MOST_FOR_A_TRIAL * training.steps


def _exposure(looks: Sequence[PhotoLook], settings: PlanSettings, can_try: bool, left_out: list[LeftOut]) -> bool:
    """Whether the photos' exposures differ by more than `EXIF_RANGE`.

    Where EXIF does not say, a trial will; and where there is none, whether their brightness by `BRIGHTNESS_SPREAD`.
    """
    if not settings.leave_out:
        return True
    values = [look.exposure_value for look in looks if look.exposure_value is not None]
    if values and len(values) == len(looks):
        difference = max(values) - min(values)
        on, why = difference > EXIF_RANGE, f"EXIF says that exposures differ by {difference:.2f} stops at most"
        why += f", the limit is {EXIF_RANGE}"
    elif can_try:
        return True
    else:
        deviation = float(np.std([look.brightness for look in looks])) if looks else 0.0
        on, why = deviation > BRIGHTNESS_SPREAD, f"the photos' brightness varies by {deviation:.2f} stops"
        why += f" (standard deviation), the limit is {BRIGHTNESS_SPREAD}; EXIF does not say all exposures"
    if not on:
        left_out.append(LeftOut("a brightness correction per photo", why))
    return on


def _notes(photo_set: PhotoSet, texture: float, poses_given: bool) -> tuple[str, ...]:
    notes = []
    count = len(photo_set.photos)
    if photo_set.rejected:
        notes.append(f"{len(photo_set.rejected)} files are not used; the report says which and why.")
    if count < FEW_PHOTOS:
        notes.append(f"{count} photos are few: 20 to 60 around an object work well.")
    if texture < LITTLE_TEXTURE and not poses_given:
        notes.append(
            f"The photos show little texture ({texture:.0%} of their pixels): cameras may not be found. "
            "Photograph the object with its surroundings."
        )
    without = sum(photo.focal_px is None for photo in photo_set.photos)
    if without and not poses_given:
        notes.append(f"{without} photos do not say their focal length: it is estimated.")
    return tuple(notes)


def training_settings(work: WorkPlan) -> TrainingSettings:
    """Return the preset with what the plan decided about it."""
    preset = PRESETS[work.preset]
    # Taken more often, the same loss weighs less each time.
    share = work.clustering_interval / preset.clustering_interval
    return replace(
        preset,
        steps=work.steps,
        clustering_interval=work.clustering_interval,
        lambda_clustering=preset.lambda_clustering * share,
        lambda_ray=preset.lambda_ray * share,
        sh_interval=max(1, preset.sh_interval * work.steps // preset.steps),
        features=work.features,
        exposure=work.exposure,
        passers_by=work.passers_by,
        stop_when_flat=work.stop_when_flat,
        trial=work.trial,
    )


def plan_scene(work: WorkPlan, camera_set: CameraSet) -> ScenePlan:
    """Name the held-out and mask photos among those that were placed.

    Parameters
    ----------
    work : WorkPlan
    camera_set : CameraSet
    """
    names = [camera.photo for camera in camera_set.cameras]
    every = PRESETS[work.preset].held_out_every
    held_out = tuple(names[every // 2 :: every]) if every else ()
    wanted = min(work.n_mask_photos, len(names))
    mask_photos: tuple[str, ...] = ()
    if wanted == len(names):
        mask_photos = tuple(sorted(names))
    elif wanted:
        judged = spread(held_out, max(1, wanted // 6)) if held_out else ()
        trained = spread([name for name in names if name not in held_out], wanted - len(judged))
        mask_photos = tuple(sorted({*judged, *trained}))
    left_out = work.left_out
    if work.n_held_out and not held_out:
        left_out += (LeftOut("held-out photos", f"only {len(names)} photos could be placed: too few to spare one"),)
    return ScenePlan(held_out, mask_photos, work.features, left_out)
