"""Views of a scene's features and Gaussians from the cameras of its photos, whose features are rendered once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np

from ..cameras import covering_pinhole, distort, is_point_visible, undistort
from ..core.arrays import Float32, Floats, Int32, Mask, normalized
from ..core.errors import ObjectError
from ..pictures import Scene
from ..pictures.settings import VISIBLE_SHARE
from ..scene import Camera, CameraSet, PinholeCamera

_COVERED_ALPHA = 0.5
"""Alpha above which a pixel shows Gaussians more than what is behind them, so that its feature is one of the scene."""

_INSIDE = 0.5
"""Value above which a pixel is inside of a mask that was resampled: the nearer of 0 and 1."""

SAME_IOU = 0.95  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""IoU above which two sets of Gaussians are the same."""

MIN_VISIBLE_PIXELS = 60  # chosen on museum_room
"""Smallest area in a view's frame that shows what an object is, in pixels."""

OUTER = 0.05
"""Share of the Gaussians of a set, at each end of an axis, that its box leaves out."""


_N_KEPT = 32
"""Views that are kept, more than one prompt looks at. One takes up to 15 MB when its features were read."""


@dataclass(frozen=True)
class View:
    """The frame of one photo, and the features of a scene in it, which are rendered at their first use.

    Attributes
    ----------
    camera : Camera
        Of the photo.
    frame : PinholeCamera
        An undistorted picture of h x w pixels that contains the whole photo.
    within : array of shape [h, w], bool
        Pixels inside of the photo.
    scene : Scene
    """

    camera: Camera
    frame: PinholeCamera
    within: Mask
    scene: Scene

    @property
    def features(self) -> Float32:
        """Features at unit length, [h, w, D]."""
        return self._seen[0]

    @property
    def covered(self) -> Mask:
        """Pixels of `within` of which Gaussians cover more than half, [h, w]."""
        return self._seen[1]

    @cached_property
    def _seen(self) -> tuple[Float32, Mask]:
        """`features` and `covered`. The rendered channels, which take as much memory, are not kept."""
        rendered = self.scene.render(self.frame, channels=self.scene.gaussians.features)
        return normalized(rendered.channels), np.asarray((rendered.alpha > _COVERED_ALPHA) & self.within)

    def from_photo(self, mask: Mask) -> Mask:
        """Return a mask of the photo, bool at any resolution, in the frame, [h, w]."""
        return self.labels_from_photo(mask.astype(np.int32)) > 0

    def labels_from_photo(self, labels: Int32) -> Int32:
        """Return a label map of the photo, int32 at any resolution, in the frame, [h, w]; 0 outside of the photo."""
        return np.where(self.within, undistort(labels, self.camera, self.frame, interpolation="nearest"), np.int32(0))

    def to_photo(self, mask: Mask) -> Mask:
        """Return a mask of the frame, [h, w], in the photo at full resolution, bool [H, W]."""
        return np.asarray(distort(mask.astype(np.float32), self.frame, self.camera) > _INSIDE)


@dataclass
class Views:
    """Views of one scene, each made when it is used; the `_N_KEPT` used last are kept.

    Attributes
    ----------
    scene : Scene
    cameras : CameraSet
    render_side : int
        Longer side of each view in pixels.

    Raises
    ------
    ObjectError
        When the scene has no features.
    """

    scene: Scene
    cameras: CameraSet
    render_side: int
    _views: OrderedDict[str, View] = field(default_factory=OrderedDict, repr=False)

    def __post_init__(self) -> None:
        if self.scene.gaussians.features is None:
            raise ObjectError(
                "This scene was trained without segmentation features, so no object can be isolated. "
                "Reconstruct it again with objects wanted."
            )

    @property
    def directions(self) -> Float32:
        """Features of the Gaussians at unit length, shape [N, D]."""
        assert self.scene.gaussians.features is not None
        return normalized(self.scene.gaussians.features)

    @cached_property
    def length_unit(self) -> float:
        """The unit of lengths, world units: the median distance of the cameras from the middle of the Gaussians."""
        centers = np.stack([camera.center for camera in self.cameras.cameras])
        return float(np.median(np.linalg.norm(centers - self.middle, axis=1))) or 1.0

    @cached_property
    def middle(self) -> Float32:
        """The median of the positions of the Gaussians, [3]."""
        return np.median(self.scene.gaussians.means, axis=0)

    def of(self, camera: Camera) -> View:
        """Return the view of a photo."""
        view = self._views.pop(camera.photo, None)
        if view is None:
            frame = covering_pinhole(camera, max_side=self.render_side)
            photo = np.ones((frame.height, frame.width), np.uint8)
            within = np.asarray(undistort(photo, camera, frame, interpolation="nearest")) > 0
            view = View(camera, frame, within, self.scene)
        self._views[camera.photo] = view
        while len(self._views) > _N_KEPT:
            self._views.popitem(last=False)
        return view

    def from_anywhere(self, camera: Camera | PinholeCamera) -> View:
        """Return the view of a camera that need not be that of a photo; its `View.camera` is then called ``""``."""
        if isinstance(camera, Camera):
            return self.of(camera)
        K = camera.K
        lens = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
        self._views.pop("", None)
        return self.of(Camera("", camera.width, camera.height, "PINHOLE", lens, camera.viewmat))

    def visible(self, view: View, members: Mask) -> Mask:
        """Return the pixels of `view` that show the members, bool [N]: of which they make up more than half."""
        return self.scene.share(view.frame, members) > VISIBLE_SHARE

    def visible_masks(self, view: View, members: Mask) -> Iterator[Mask]:
        """Yield `visible` within the photo of `view`, bool [h, w], for each of K sets of Gaussians, bool [K, N]."""
        for share in self.scene.shares(view.frame, members):
            yield (share > VISIBLE_SHARE) & view.within

    def extent(self, members: Mask) -> float:
        """Return the longest side of the `inner_box` of the members, bool [N], in `length_unit`; 0 for none."""
        if not members.any():
            return 0.0
        low, _, high = inner_box(self.scene.gaussians.means[members])
        return float((high - low).max() / self.length_unit)

    def facing(self, point: Floats) -> list[Camera]:
        """Return the cameras whose photo contains the world point [3]."""
        return [camera for camera in self.cameras.cameras if is_point_visible(camera, point)]


def inner_box(means: Floats) -> Floats:
    """Return low, middle and high corner of positions, without a twentieth at each end of an axis.

    Parameters
    ----------
    means : array of shape [n, 3], float, n > 0

    Returns
    -------
    array of shape [3, 3], float
    """
    return np.quantile(means, (OUTER, 1 / 2, 1 - OUTER), axis=0)


def spread_cameras(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Return `count` cameras that differ most in position and direction; all of them when there are fewer.

    The first is the most central one, and each further one the farthest from those before, with positions in units of
    their spread and view directions as unit vectors.
    """
    if len(cameras) <= count:
        return list(cameras)
    positions = np.stack([camera.center for camera in cameras])
    spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean()) or 1.0
    poses = np.hstack([positions / spread, np.stack([camera.viewmat[2, :3] for camera in cameras])])
    selected = [int(np.linalg.norm(poses - poses.mean(axis=0), axis=1).argmin())]
    distance = np.linalg.norm(poses - poses[selected[0]], axis=1)
    while len(selected) < count:
        selected.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(poses - poses[selected[-1]], axis=1))
    return [cameras[i] for i in selected]


def erode_mask(mask: Mask, pixels: int) -> Mask:
    """Return `mask` with up to `pixels` removed along its border: fewer where nothing would be left."""
    for times in range(pixels, 0, -1):
        # Without a kernel, OpenCV takes the pixel and its 8 neighbours.
        smaller = cv2.erode(mask.astype(np.uint8), None, iterations=times, borderType=cv2.BORDER_REPLICATE) > 0
        if smaller.any():
            return np.asarray(smaller)
    return mask
