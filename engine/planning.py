"""What this scene needs: decided from the photos, the cameras and what the person wants, before the work.

The plan says what is done, and lists what is left out with the reason; the report repeats it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .cameras.camera import CameraSet
from .photos.photo import PhotoSet

__all__ = ["LeftOut", "PlanSettings", "ScenePlan", "plan_scene", "spread"]


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
    """

    preset: str = "standard"
    wants_objects: bool = True
    n_mask_photos: int = 28


@dataclass(frozen=True)
class LeftOut:
    """Something this scene does not need."""

    what: str
    why: str


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


def plan_scene(photo_set: PhotoSet, camera_set: CameraSet, settings: PlanSettings, *, held_out_every: int) -> ScenePlan:
    """Decide what the registered photos need.

    Parameters
    ----------
    photo_set : PhotoSet
    camera_set : CameraSet
    settings : PlanSettings
    held_out_every : int
        Every so many-th photo is held out, 0 for none; as `TrainingSettings.held_out_every`.

    Returns
    -------
    ScenePlan
    """
    names = [camera.photo for camera in camera_set.cameras]
    held_out = tuple(names[held_out_every // 2 :: held_out_every]) if held_out_every else ()
    left_out: list[LeftOut] = []
    mask_photos: tuple[str, ...] = ()
    if settings.wants_objects:
        judged = spread(held_out, max(1, settings.n_mask_photos // 6)) if held_out else ()
        trained = spread([name for name in names if name not in held_out], settings.n_mask_photos - len(judged))
        mask_photos = tuple(sorted({*judged, *trained}))
        if len(mask_photos) < len(names):
            left_out.append(
                LeftOut(
                    f"masks of {len(names) - len(mask_photos)} of {len(names)} photos",
                    f"{len(mask_photos)} evenly spread photos show every segment several times; "
                    "each further one costs seconds and shows it again",
                )
            )
    else:
        left_out.append(LeftOut("masks and segmentation features", "no objects were asked for (--no-objects)"))
    if camera_set.poses_given:
        left_out.append(LeftOut("structure from motion", "camera poses were given"))
    if len({(photo.width, photo.height, photo.focal_px) for photo in photo_set.photos}) == 1:
        left_out.append(
            LeftOut("a lens model per photo", "all photos have one size and focal length: one lens is shared")
        )
    if not held_out:
        left_out.append(LeftOut("held-out photos", f"{len(names)} photos are too few to spare one"))
    return ScenePlan(held_out, mask_photos, settings.wants_objects, tuple(left_out))
