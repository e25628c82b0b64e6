"""What training reads of each photo: pinhole picture, camera, labels; at full size and smaller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import TrainingError
from ..events import StopCheck, never_stop
from ..rasterizer import Target
from ..scene import Camera, CameraSet, PinholeCamera
from .losses import LabelledPixels, labelled_pixels
from .settings import PAPER_PIXELS, TrainingSettings

__all__ = ["Level", "TrainingView", "ViewPyramid", "is_held_out", "load_views", "scene_extent"]

_TARGET_BYTES = 36
_MOST_TARGET_BYTES = 1 << 30


@dataclass(frozen=True)
class TrainingView:
    """One photo as training sees it.

    Attributes
    ----------
    photo : str
        Name of the photo.
    pinhole : PinholeCamera
        Camera of `pixels`.
    pixels : array of shape [h, w, 3], uint8, sRGB
        The photo without distortion, no blank border.
    labels : array of shape [h, w], int32, or None
        SAM segments in the same frame, 0 for none.
    held_out : bool
        Never trained on.
    valid : bool array of shape [h, w], or None
        Pixels that count, in the loss and in what is measured; None for all.
    """

    photo: str
    pinhole: PinholeCamera
    pixels: NDArray[np.uint8]
    labels: NDArray[np.int32] | None
    held_out: bool
    valid: NDArray[np.bool_] | None = None


def is_held_out(index: int, every: int) -> bool:
    """Return whether photo number `index` (by name) is held out: the middle one of each `every`."""
    return every > 0 and index % every == every // 2


def load_views(
    photo_folder: Path,
    camera_set: CameraSet,
    masks: Mapping[str, Path],
    settings: TrainingSettings,
    *,
    photo_masks: Mapping[str, Path] | None = None,
    should_stop: StopCheck = never_stop,
) -> list[TrainingView]:
    """Return the training views of all registered photos: undistorted, at most ``settings.max_side`` wide and high.

    Parameters
    ----------
    photo_folder : Path
        Where the photos lie.
    camera_set : CameraSet
        Cameras of the registered photos.
    masks : mapping of str to Path
        Label maps of the masks room by photo name; photos without one are trained on without labels.
    settings : TrainingSettings
    photo_masks : mapping of str to Path, optional
        Which pixels of a photo count, see `photos.photo_masks`, by photo name.
    should_stop : StopCheck
        Asked per photo.

    Returns
    -------
    list of TrainingView
        Pixels that do not count have no label.

    Raises
    ------
    Cancelled
        When asked to stop.
    PhotoError
        When a photo or mask went away or they do not fit.
    TrainingError
        When a photo has another aspect than its camera, or nothing of it counts.
    """
    from ..cameras import training_pinhole, undistort
    from ..errors import Cancelled
    from ..masks import read_label_map
    from ..photos import load_with_valid

    views = []
    for index, camera in enumerate(camera_set.cameras):
        if should_stop():
            raise Cancelled("Stopped while the photos were loaded for training.")
        pinhole = training_pinhole(camera, max_side=settings.max_side)
        # Twice the target size is all that resampling needs; a 48-megapixel photo would cost half a second each.
        source, counted = load_with_valid(
            photo_folder / camera.photo,
            (photo_masks or {}).get(camera.photo),
            max_side=2 * max(pinhole.width, pinhole.height),
        )
        _check_aspect(source, camera)
        pixels = undistort(source, camera, pinhole, interpolation="linear")
        valid = None
        if counted is not None:
            # Linear as the pixels: one counts when all that it is mixed of does.
            valid = undistort(counted.astype(np.float32), camera, pinhole, interpolation="linear") > 1.0 - 1e-4
        labels = None
        if settings.features and camera.photo in masks:
            labels = undistort(read_label_map(masks[camera.photo]), camera, pinhole, interpolation="nearest")
            labels = labels if valid is None else np.where(valid, labels, 0).astype(np.int32)
        held_out = is_held_out(index, settings.held_out_every)
        views.append(TrainingView(camera.photo, pinhole, pixels, labels, held_out, valid))
    return views


def _check_size(view: TrainingView) -> None:
    height, width = view.pixels.shape[:2]
    if (width, height) != (view.pinhole.width, view.pinhole.height):
        raise TrainingError(
            f"{view.photo} has {width} x {height} pixels, its camera {view.pinhole.width} x {view.pinhole.height}. "
            "Put back the photo that the cameras were found with, or find them anew."
        )
    if view.valid is not None and not view.valid.any():
        raise TrainingError(
            f"The mask or transparency of {view.photo} leaves nothing of it. Take it out of the folder, or its mask."
        )


def _check_aspect(pixels: NDArray[np.uint8], camera: Camera) -> None:
    """Refuse a photo that was exchanged or turned since its camera was found; a smaller copy is the same photo."""
    height, width = pixels.shape[:2]
    # Rounding a smaller copy to whole pixels changes the product by half of the other side at most.
    if abs(width * camera.height - height * camera.width) > max(camera.width, camera.height):
        raise TrainingError(
            f"{camera.photo} has the shape of {width} x {height} pixels, its camera of {camera.width} x "
            f"{camera.height}. Put back the photo that the cameras were found with, or find them anew."
        )


def scene_extent(cameras: Sequence[PinholeCamera]) -> float:
    """Return 1.1 times the largest distance from the mean camera (Kerbl et al. 2023); 1 for a single camera."""
    centers = np.stack([camera.center for camera in cameras])
    radius = 1.1 * float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max())
    return radius if radius > 1e-3 else 1.0


@dataclass(frozen=True)
class Level:
    """A view at one resolution.

    Attributes
    ----------
    camera : PinholeCamera
    pixels : array of shape [h, w, 3], uint8, sRGB
    prepared : Target or None
        The photo made ready for the loss, None where keeping it would take too much memory.
    labelled : LabelledPixels or None
    valid : bool array of shape [h, w], or None
        Pixels that count; None for all.
    """

    camera: PinholeCamera
    pixels: NDArray[np.uint8]
    prepared: Target | None
    labelled: LabelledPixels | None
    valid: NDArray[np.bool_] | None = None

    @property
    def target(self) -> Target:
        """The photo ready for the loss."""
        return self.prepared or Target(self.pixels, valid=self.valid)


@dataclass
class ViewPyramid:
    """The views at every size; a size of a view is made when it is first asked for."""

    views: Sequence[TrainingView]
    settings: TrainingSettings
    _keep_targets: bool = field(init=False)
    _levels: dict[tuple[int, int], Level] = field(default_factory=dict)
    _left_out: dict[int, NDArray[np.bool_]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.views:
            raise TrainingError("There is no photo to train on. Add photos and run again.")
        for view in self.views:
            _check_size(view)
        pixels = sum(view.pixels.shape[0] * view.pixels.shape[1] for view in self.views)
        self._keep_targets = pixels * _TARGET_BYTES <= _MOST_TARGET_BYTES

    def level(self, view: int, shrinks: int) -> Level:
        """Return view number `view` made smaller by sqrt(2) `shrinks` times."""
        key = (view, shrinks)
        if key not in self._levels:
            chosen = _without(self.views[view], self._left_out.get(view))
            self._levels[key] = _make_level(chosen, shrinks, self.settings, keep_target=self._keep_targets)
        return self._levels[key]

    def as_given(self, view: int, shrinks: int) -> Level:
        """Return a view as `level` does, but with what was left out of it; it is made anew each time."""
        return _make_level(self.views[view], shrinks, self.settings, keep_target=False)

    def leave_out(self, masks: Mapping[int, NDArray[np.bool_]]) -> None:
        """From now on, leave these pixels out of the views of these numbers, and none that were left out before.

        Parameters
        ----------
        masks : mapping of int to bool array of shape [h, w]
            True where a pixel does not count; at any size.
        """
        changed = {*self._left_out, *masks}
        self._left_out = dict(masks)
        self._levels = {key: level for key, level in self._levels.items() if key[0] not in changed}

    def forget(self, shrinks: int) -> None:
        """Free the levels that are made smaller more often than `shrinks` times."""
        self._levels = {key: level for key, level in self._levels.items() if key[1] <= shrinks}


def _without(view: TrainingView, mask: NDArray[np.bool_] | None) -> TrainingView:
    """Return the view with the pixels of `mask` not counting any more, nor their segments."""
    if mask is None:
        return view
    height, width = view.pixels.shape[:2]
    out = cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    valid = ~out if view.valid is None else view.valid & ~out
    labels = None if view.labels is None else np.where(valid, view.labels, 0).astype(np.int32)
    return replace(view, valid=valid, labels=labels)


def _make_level(view: TrainingView, shrinks: int, settings: TrainingSettings, *, keep_target: bool) -> Level:
    pinhole, pixels, labels, valid = view.pinhole, view.pixels, view.labels, view.valid
    if shrinks:
        width, height = (max(8, round(side * 2.0 ** (-shrinks / 2))) for side in (pinhole.width, pinhole.height))
        factors = np.array([width / pinhole.width, height / pinhole.height, 1.0])
        pinhole = PinholeCamera(pinhole.viewmat, pinhole.K * factors[:, None], width, height)
        pixels = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        if labels is not None:
            labels = np.asarray(cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST_EXACT))
        if valid is not None:
            share = cv2.resize(valid.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            # A pixel counts when all that it stands for does; of a mask finer than that, what counts most.
            valid = np.asarray(share >= min(1.0 - 1e-4, float(share.max())))
    labelled = None
    if labels is not None and settings.features and not view.held_out:
        min_pixels = max(8, round(settings.min_segment_pixels * labels.size / PAPER_PIXELS))
        labelled = labelled_pixels(labels, min_pixels=min_pixels)
    pixels = np.ascontiguousarray(pixels)
    return Level(pinhole, pixels, Target(pixels, valid=valid) if keep_target else None, labelled, valid)
