"""Training views: the undistorted picture, camera and labels of each photo, at full size and smaller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.errors import TrainingError
from ..core.events import StopCheck, never_stop
from ..core.files import ScratchFile
from ..core.label_runs import LabelRuns
from ..scene import Camera, CameraSet, PinholeCamera
from .losses import LabelledPixels, Target, labelled_pixels
from .settings import PAPER_PIXELS, FeatureSettings, TrainingSettings

_MIN_SEGMENT_PIXELS = 100  # Dahaghin et al. 2024
"""Smaller segments are left out of L_CC. Counted at 980 x 735 pixels and scaled to the picture."""

TARGET_BYTES_PER_PIXEL = 36
"""Memory of a prepared `Target` per pixel, bytes."""

MAX_TARGET_BYTES = 1 << 30
"""Largest memory of all prepared targets, bytes. Beyond it they are prepared in each step."""


_NO_PIXELS = np.zeros((0, 0, 3), np.uint8)
"""In place of pixels that lie in a file."""

MAX_PIXEL_BYTES = 1 << 30
"""Largest memory of the pictures of all photos, bytes. Beyond it they lie in a file that is mapped into memory."""


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
        The undistorted photo, without blank border.
    labels : LabelRuns or None
        Segments of the same pixels, 0 for none; None where the photo has no label map.
    held_out : bool
        Whether the photo is a test photo: measured and never trained on, and nothing is decided on it.
    valid : bool array of shape [h, w], or None
        Pixels that are used for the loss and for measurements; None for all.
    """

    photo: str
    pinhole: PinholeCamera
    pixels: NDArray[np.uint8]
    labels: LabelRuns | None
    held_out: bool
    valid: NDArray[np.bool_] | None = None


def is_held_out(index: int, every: int) -> bool:
    """Return whether photo number `index`, in order of names, is a test photo: the middle one of `every` photos."""
    return every > 0 and index % every == every // 2


def load_views(
    photo_folder: Path,
    camera_set: CameraSet,
    masks: Mapping[str, Path],
    settings: TrainingSettings,
    *,
    photo_masks: Mapping[str, Path] | None = None,
    scratch: Path | None = None,
    should_stop: StopCheck = never_stop,
) -> list[TrainingView]:
    """Return the training views of all registered photos: undistorted, at most ``max_side`` wide and high.

    Parameters
    ----------
    photo_folder : Path
        Folder of the photos.
    camera_set : CameraSet
        Cameras of the registered photos.
    masks : mapping of str to Path
        Files of the label maps by photo name. Photos without one are trained on without labels.
    photo_masks : mapping of str to Path, optional
        Files of the masks of valid pixels by photo name, see `photos.photo_masks`.
    scratch : Path, optional
        Folder for a temporary file of pictures that take more than `MAX_PIXEL_BYTES`; None keeps them in memory.
    should_stop : StopCheck
        Called before each photo.

    Returns
    -------
    list of TrainingView
        Invalid pixels have no label. Where a photo is transparent it is black and valid: nothing is there.

    Raises
    ------
    Cancelled
        When `should_stop` returns true.
    PhotoError
        When a photo or mask is missing, or their sizes differ.
    TrainingError
        When the aspect ratios of a photo and its camera differ, or no pixel is valid.
    DiskError
        When there is no room for the file in `scratch`.
    """
    from ..cameras import training_pinhole

    pinholes = [training_pinhole(camera, max_side=settings.schedule.max_side) for camera in camera_set.cameras]
    loaded = _each_view(photo_folder, camera_set, pinholes, masks, settings, photo_masks or {}, should_stop)
    if scratch is None or sum(3 * pinhole.width * pinhole.height for pinhole in pinholes) <= MAX_PIXEL_BYTES:
        return list(loaded)
    views = []
    with ScratchFile(scratch) as file:
        for view in loaded:
            file.add(view.pixels)
            views.append(replace(view, pixels=_NO_PIXELS))
        return [replace(view, pixels=pixels) for view, pixels in zip(views, file.arrays(), strict=True)]


def _each_view(
    photo_folder: Path,
    camera_set: CameraSet,
    pinholes: Sequence[PinholeCamera],
    masks: Mapping[str, Path],
    settings: TrainingSettings,
    photo_masks: Mapping[str, Path],
    should_stop: StopCheck,
) -> Iterator[TrainingView]:
    """Yield the views of `load_views`, each read when it is asked for."""
    from ..cameras import undistort
    from ..core.errors import Cancelled
    from ..masks import read_label_map
    from ..photos import load_with_valid

    for index, (camera, pinhole) in enumerate(zip(camera_set.cameras, pinholes, strict=True)):
        if should_stop():
            raise Cancelled("Stopped while the photos were loaded for training.")
        # Resampling needs no more than twice the target size. A photo of 48 megapixels would cost half a second.
        source, source_valid = load_with_valid(
            photo_folder / camera.photo,
            photo_masks.get(camera.photo),
            max_side=2 * max(pinhole.width, pinhole.height),
            # The background that is rendered.
            over_black=True,
        )
        _check_aspect(source, camera)
        pixels = undistort(source, camera, pinhole, interpolation="linear")
        valid = None
        if source_valid is not None:
            # Interpolated like the pixels: a pixel is valid when all pixels that it is interpolated from are valid.
            valid = undistort(source_valid.astype(np.float32), camera, pinhole, interpolation="linear") > 1.0 - 1e-4
        labels = None
        if settings.features.train_features and camera.photo in masks:
            segments = undistort(read_label_map(masks[camera.photo]), camera, pinhole, interpolation="nearest")
            labels = LabelRuns.of(segments if valid is None else np.where(valid, segments, 0).astype(np.int32))
        held_out = is_held_out(index, settings.measurement.held_out_every)
        yield TrainingView(camera.photo, pinhole, pixels, labels, held_out, valid)


def _check_size(view: TrainingView) -> None:
    height, width = view.pixels.shape[:2]
    if (width, height) != (view.pinhole.width, view.pinhole.height):
        raise TrainingError(
            f"{view.photo} has {width} x {height} pixels, its camera {view.pinhole.width} x {view.pinhole.height}. "
            "Restore the photo that the cameras were estimated from, or estimate the cameras again."
        )
    if view.valid is not None and not view.valid.any():
        raise TrainingError(
            f"The mask or transparency of {view.photo} excludes all of its pixels. Remove the photo, or its mask."
        )


def _check_aspect(pixels: NDArray[np.uint8], camera: Camera) -> None:
    """Refuse a photo that was replaced or rotated after its camera was estimated; a smaller copy is accepted."""
    height, width = pixels.shape[:2]
    # Rounding a smaller copy to whole pixels changes each product by half of a side at most.
    if abs(width * camera.height - height * camera.width) > max(camera.width, camera.height):
        raise TrainingError(
            f"{camera.photo} has the shape of {width} x {height} pixels, its camera of {camera.width} x "
            f"{camera.height}. Restore the photo that the cameras were estimated from, or estimate the cameras again."
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
        The photo prepared for the loss, None where keeping it would need too much memory.
    labelled : LabelledPixels or None
    valid : bool array of shape [h, w], or None
        Valid pixels; None for all.
    """

    camera: PinholeCamera
    pixels: NDArray[np.uint8]
    prepared: Target | None
    labelled: LabelledPixels | None
    valid: NDArray[np.bool_] | None = None

    @property
    def target(self) -> Target:
        """The photo prepared for the loss."""
        return self.prepared or Target(self.pixels, valid=self.valid)


@dataclass
class ViewPyramid:
    """The views at every size; each size of a view is made at its first use.

    Attributes
    ----------
    views : sequence of TrainingView
    settings : FeatureSettings
    prepares_targets : bool
        Keep the photos prepared for the loss on the processor if memory allows.
    """

    views: Sequence[TrainingView]
    settings: FeatureSettings
    prepares_targets: bool = True
    _keep_targets: bool = field(init=False)
    _levels: dict[tuple[int, int], Level] = field(default_factory=dict)
    _masked: dict[int, NDArray[np.bool_]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.views:
            raise TrainingError("There is no photo to train on. Add photos and run again.")
        for view in self.views:
            _check_size(view)
        pixels = sum(view.pixels.shape[0] * view.pixels.shape[1] for view in self.views)
        self._keep_targets = self.prepares_targets and pixels * TARGET_BYTES_PER_PIXEL <= MAX_TARGET_BYTES

    def level(self, view: int, reductions: int) -> Level:
        """Return view number `view` reduced by sqrt(2) `reductions` times."""
        key = (view, reductions)
        if key not in self._levels:
            chosen = _without_pixels(self.views[view], self._masked.get(view))
            self._levels[key] = _make_level(chosen, reductions, self.settings, keep_target=self._keep_targets)
        return self._levels[key]

    def unmasked_level(self, view: int, reductions: int) -> Level:
        """Return a level without the masks of `mask_pixels`; it is made at each call."""
        return _make_level(self.views[view], reductions, self.settings, keep_target=False)

    def mask_pixels(self, masks: Mapping[int, NDArray[np.bool_]]) -> None:
        """Exclude pixels of some views from now on; these masks replace the earlier ones.

        Parameters
        ----------
        masks : mapping of int to bool array of shape [h, w]
            True for excluded pixels, by number of the view; at any size.
        """
        changed = {*self._masked, *masks}
        self._masked = dict(masks)
        self._levels = {key: level for key, level in self._levels.items() if key[0] not in changed}

    def free_smaller_levels(self, reductions: int) -> None:
        """Free the levels that are reduced more often than `reductions` times."""
        self._levels = {key: level for key, level in self._levels.items() if key[1] <= reductions}


def _without_pixels(view: TrainingView, mask: NDArray[np.bool_] | None) -> TrainingView:
    """Return the view with the pixels of `mask` invalid and without label."""
    if mask is None:
        return view
    height, width = view.pixels.shape[:2]
    excluded = cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    valid = ~excluded if view.valid is None else view.valid & ~excluded
    labels = None
    if view.labels is not None:
        labels = LabelRuns.of(np.where(valid, view.labels.array(), 0).astype(np.int32))
    return replace(view, valid=valid, labels=labels)


def _make_level(view: TrainingView, reductions: int, settings: FeatureSettings, *, keep_target: bool) -> Level:
    pinhole, pixels, valid = view.pinhole, view.pixels, view.valid
    is_labelled = view.labels is not None and settings.train_features and not view.held_out
    labels = view.labels.array() if view.labels is not None and is_labelled else None
    if reductions:
        width, height = (max(8, round(side * 2.0 ** (-reductions / 2))) for side in (pinhole.width, pinhole.height))
        pinhole = pinhole.resized(width, height)
        pixels = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        if labels is not None:
            labels = np.asarray(cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST_EXACT))
        if valid is not None:
            share = cv2.resize(valid.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            # A pixel is valid when all pixels that it replaces are. Where the mask is too fine for any such pixel, the
            # pixels with the largest valid share are.
            valid = np.asarray(share >= min(1.0 - 1e-4, float(share.max())))
    labelled = None
    if labels is not None:
        min_pixels = max(8, round(_MIN_SEGMENT_PIXELS * labels.size / PAPER_PIXELS))
        labelled = labelled_pixels(labels, min_pixels=min_pixels)
    pixels = np.ascontiguousarray(pixels)
    return Level(pinhole, pixels, Target(pixels, valid=valid) if keep_target else None, labelled, valid)
