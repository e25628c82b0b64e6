"""The parts of photos that show an object, cut out for detail, with maps of where it shows and covers what."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from ..cameras import training_pinhole, undistort
from ..core.arrays import Float32, Mask, Pixels
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..core.system import usable_cores
from ..masks import mask_box
from ..photos import load_with_valid
from ..pictures import Rendered, Scene
from ..pictures.settings import VISIBLE_SHARE
from ..project.folder import ProjectFolder
from ..scene import Camera, PinholeCamera
from ..training import DetailCrop
from ..training.settings import TEST_PHOTOS
from .context import photo_folder_of
from .views import MIN_VISIBLE_PIXELS, Views, erode_mask, inner_box

_MIN_INSIDE = 0.5  # chosen on room_1, room_5, herz_jesus25, banana16
"""Share of the pixels that show a Gaussian in the photos in which the object is what is seen, from which on detail is
made of it. The others are part of something else."""

_WELL_SEEN = 0.5  # chosen on room_5, room_7
"""Share of the pixels that a Gaussian has in the object alone, which the photos must show of it: less says nothing."""

_MIN_SHARE = 0.3  # chosen on museum_room
"""Share of a pixel that the object contributes in the scene at which the coverage that it has alone starts to rise; it
is 1 at one minus this."""

_OCCLUDER_DISTANCE = 0.25  # chosen on museum_room
"""Distance in front of the object, in its radii, from which on other Gaussians hide it. What is closer is the wall or
support that a Gaussian of the object reaches into."""

_AGREEING = 0.12  # chosen on museum_room
"""Largest mean difference between colours of the object alone and those of the photo, 0 to 1, at which they agree."""

_RIM_SHARE = 1 / 300
"""Width of the edge that may be translucent, as a share of the longer side of the photo that the scene was seen in."""

_MARGIN = 0.08
"""Margin around the object in a crop, as a share of its box."""

_COMPARED_SHARE = 0.02
"""Share of a pixel that the object contributes from which on the pixel, with a margin, is compared with the photo."""

_MAX_SIDE = 4096
"""Longest side, in pixels, at which a photo is read. Larger ones are reduced, which the result says."""

_MAP_PIXELS = 600_000
"""Largest maps of a crop, in pixels: where it shows the object. The scene, trained on small photos, knows no more."""

_MAX_PIXELS = 160_000_000
"""Pixels of all crops together, 3 bytes each. If they have more, all are reduced, which the result says."""

_PASSES = 4.0
"""How often the steps are to compare each pixel of the object. If they are too few, all crops are reduced, which the
result says, but not below the size of their maps: windows that are seen once are fitted to one photo alone."""

_CARD_SIDE = 256
"""Sides of the maps' pictures on a card are multiples of this."""

_READERS = 8
"""Photos that are read at a time: each takes the memory of a whole photo."""


@dataclass(frozen=True)
class DetailPhotos:
    """The photos of a project as detail uses them.

    Attributes
    ----------
    folder : Path
    held_out : collection of str
        Names of the test photos, which nothing is trained on; they decide whether detail is kept.
    gains : mapping of str to sequence of 3 float
        Brightness of photos relative to the scene; 1 for others.
    masks : mapping of str to Path
        Files of the masks of valid pixels by photo.
    trained_side : int
        Longer side of the photos as the scene was trained on them, in pixels.
    """

    folder: Path
    held_out: frozenset[str] = frozenset()
    gains: Mapping[str, Sequence[float]] = field(default_factory=dict)
    masks: Mapping[str, Path] = field(default_factory=dict)
    trained_side: int = 640

    def gain(self, photo: str) -> Float32:
        """Return the brightness of a photo relative to the scene, [3]."""
        return np.asarray(self.gains.get(photo, (1.0, 1.0, 1.0)), np.float32)

    @classmethod
    def of(cls, project: ProjectFolder) -> DetailPhotos:
        """Return the photos of a trained project.

        Raises
        ------
        FormatError
            When the project does not name their folder.
        """
        from ..scene import read_photo_set

        record = project.stage_record("training") or {}
        figures, given = record.get("figures", {}), (record.get("run") or {}).get("settings") or {}
        # Where there is no test photo, the scene was measured on photos that it was trained on.
        measured = figures.get("measured_photos") if figures.get("measured_on") == TEST_PHOTOS else None
        held_out = measured if isinstance(measured, list) else []
        masks: Mapping[str, Path] = {}
        if (listing := project.path / "photos" / "photos.json").is_file():
            masks = read_photo_set(listing).mask_files
        side = given.get("max_side")
        trained_side = side if isinstance(side, int) and side > 0 else cls.trained_side
        return cls(photo_folder_of(project), frozenset(held_out), figures.get("exposure") or {}, masks, trained_side)


class DetailCutter:
    """Cuts the parts that show an object out of photos.

    Parameters
    ----------
    members : array of shape [N], bool
    cameras : sequence of Camera
        Of training photos and of test photos.

    Attributes
    ----------
    left : array of shape [N], bool
        Those of the members that are trained: the photos show them inside of the object's outline.
    scale : float
        Scale of all parts relative to the photos' own.
    n_shown : dict of str to float
        By photo, of those that show the object: its own pixels that do.
    n_reduced : int
        Photos that were read smaller than they are.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """

    def __init__(
        self, views: Views, photos: DetailPhotos, members: Mask, cameras: Sequence[Camera], should_stop: StopCheck
    ) -> None:
        self.views, self.photos, self.members = views, photos, members
        self.scale, self.n_reduced = 1.0, 0
        self.n_shown: dict[str, float] = {}
        self._frames: dict[str, PinholeCamera] = {}
        self._parts: list[tuple[Camera, PinholeCamera]] = []
        rows = np.flatnonzero(members)
        alone = views.scene.with_gaussians(replace(views.scene.gaussians[rows], features=None))
        shown, drawn = np.zeros((2, len(rows), 2), np.float32)
        for camera in cameras:
            if should_stop():
                raise Cancelled("Stopped while detailing; nothing was stored.")
            small = training_pinhole(camera, max_side=views.render_side)
            share = views.scene.share(small, members)
            visible = share > VISIBLE_SHARE
            if camera.photo not in photos.held_out:
                near = _dilated(visible, max(1, round(_RIM_SHARE * max(small.width, small.height))))
                everything = np.ones_like(visible)
                sets = [np.dstack([mask, everything]).astype(np.float32) for mask in (visible, near)]
                shown += views.scene.votes(small, sets[0])[rows]
                drawn += alone.votes(small, sets[1])
            if visible.sum() >= MIN_VISIBLE_PIXELS:
                self._parts.append((camera, self._part(camera, small, share)))
        self.left = np.zeros_like(members)
        self.left[rows[_shown_inside(shown, drawn)]] = True
        if not self.left.any():
            self.left = members
        trained = replace(views.scene.gaussians[np.flatnonzero(self.left)], features=None)
        low, _, high = inner_box(trained.means)
        self._occluder_distance = _OCCLUDER_DISTANCE * float(np.linalg.norm(high - low)) / 2
        self._alone = views.scene.with_gaussians(trained)

    @property
    def finer(self) -> float:
        """How much larger the photos are read than the scene saw them, at the median."""
        sides = [max(one.width, one.height) for one in self.views.cameras.cameras]
        return self.scale * min(float(np.median(sides)), _MAX_SIDE) / self.photos.trained_side

    def crops(self, n_compared: float) -> Iterator[DetailCrop]:
        """Yield the parts of photos that show the object. Photos are read ahead by threads.

        Parameters
        ----------
        n_compared : float
            Pixels that all steps compare.

        Raises
        ------
        PhotoError
            When a photo cannot be read.
        """
        sizes = [part.width * part.height for _, part in self._parts]
        seen = n_compared / (_PASSES * max(1.0, sum(self.n_shown.values())))
        of_maps = _MAP_PIXELS / float(np.median(sizes)) if sizes else 1.0
        self.scale = math.sqrt(min(1.0, _MAX_PIXELS / max(1, sum(sizes)), max(seen, of_maps)))
        pool = ThreadPoolExecutor(min(_READERS, len(usable_cores())))
        try:
            waiting: list[Future[DetailCrop]] = []
            for camera, part in self._parts:
                resized = part.scaled(self.scale)
                self.n_reduced += self.scale < 1.0 or max(camera.width, camera.height) > _MAX_SIDE
                waiting.append(pool.submit(self._crop, camera, resized, *self._pictures(_map_camera(resized))))
                if len(waiting) > 2 * _READERS:
                    yield waiting.pop(0).result()
            yield from (one.result() for one in waiting)
        finally:
            pool.shutdown(cancel_futures=True)

    def _crop(self, camera: Camera, part: PinholeCamera, in_scene: Rendered, isolated: Rendered) -> DetailCrop:
        """Return a part of a photo with its maps, by the pictures that `_pictures` returned."""
        share, alpha, hidden, of_trained = self._coverage(in_scene, isolated)
        small = _map_camera(part)
        pixels, valid = read_part(self.photos, camera, part, small)
        resized = cv2.resize(pixels, (small.width, small.height), interpolation=cv2.INTER_AREA)
        gain = self.photos.gain(camera.photo)
        # What the object covers alone and not in the scene is a spike, or a part of it that others show there as well.
        # The photo tells which.
        covered = isolated.alpha[..., None]
        difference = np.abs(isolated.channels[..., :3] * gain - covered * resized / np.float32(255)).mean(axis=2)
        agrees = (share <= VISIBLE_SHARE) & (isolated.alpha > VISIBLE_SHARE) & ~hidden
        agrees &= cv2.blur(difference, (5, 5)) < _AGREEING * isolated.alpha
        alpha = np.where(agrees, isolated.alpha, alpha)
        visible, known = share > VISIBLE_SHARE, valid & ~hidden
        full = self._frames[camera.photo]
        rim = max(1, round(_RIM_SHARE * max(full.width, full.height) * small.K[0, 0] / full.K[0, 0]))
        inside = erode_mask(visible, rim) & visible
        alpha = np.where(inside, np.float32(1), alpha)
        compared = _dilated(share > _COMPARED_SHARE, rim)
        shown = (inside | agrees) & valid
        return DetailCrop(
            camera.photo, part, pixels, compared & valid, inside & valid, shown, shown & of_trained,
            alpha.astype(np.float32), known, gain, float(visible.sum()),
        )  # fmt: skip

    def _part(self, camera: Camera, small: PinholeCamera, share: Float32) -> PinholeCamera:
        """Return the camera of the part of a photo that shows the object, by its share of the pixels of `small`."""
        frame = self._frames[camera.photo] = training_pinhole(camera, max_side=_MAX_SIDE)
        box = mask_box(share > _MIN_SHARE)
        assert box is not None, "the object is visible in this view"
        scale = frame.K[0, 0] / small.K[0, 0]
        self.n_shown[camera.photo] = float((share > VISIBLE_SHARE).sum()) * scale**2
        margins = [_MARGIN * (box[2] - box[0]) + 2, _MARGIN * (box[3] - box[1]) + 2]
        left, top = (max(0, math.floor((box[i] - margins[i]) * scale)) for i in (0, 1))
        right = min(frame.width, math.ceil((box[2] + margins[0]) * scale))
        bottom = min(frame.height, math.ceil((box[3] + margins[1]) * scale))
        return frame.part(left, top, right - left, bottom - top)

    def _pictures(self, part: PinholeCamera) -> tuple[Rendered, Rendered]:
        """Return the members, the depth and the trained members in the scene, and colours and depth of these alone."""
        scene: Scene = self.views.scene
        channels = np.column_stack([self.members, scene.depth_of(part), self.left]).astype(np.float32)
        # A card needs time for each new size of picture.
        side = _CARD_SIDE if scene.backend == "gpu" else 1
        width, height = (-(-one // side) * side for one in (part.width, part.height))
        picture, rows = replace(part, width=width, height=height), np.s_[: part.height, : part.width]
        shown = scene.render(picture, channels=channels)
        alone = self._alone.render(picture, color=True, channels=self._alone.depth_of(part)[:, None])
        return Rendered(shown.channels[rows], shown.alpha[rows]), Rendered(alone.channels[rows], alone.alpha[rows])

    def _coverage(self, in_scene: Rendered, isolated: Rendered) -> tuple[Float32, Float32, Mask, Mask]:
        """Return the object's share of each pixel, its coverage by it, and where something hides it.

        The last is where the trained members make up half of its share.
        """
        share = in_scene.channels[..., 0]
        # Mean depths are compared, times both alphas, which may be 0.
        farthest = (isolated.channels[..., 3] - self._occluder_distance * isolated.alpha) * in_scene.alpha
        hidden = (share < VISIBLE_SHARE) & (in_scene.channels[..., 1] * isolated.alpha < farthest)
        of_trained = in_scene.channels[..., 2] >= share / 2
        return share, np.clip((share - _MIN_SHARE) / (1 - 2 * _MIN_SHARE), 0, 1), hidden, of_trained


def _dilated(mask: Mask, width: int) -> Mask:
    """Return a mask, [h, w], with `width` pixels around it."""
    side = 2 * width + 1
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _shown_inside(shown: Float32, drawn: Float32) -> Mask:
    """Return which Gaussians belong inside of an object's outline, bool [M].

    Parameters
    ----------
    shown : array of shape [M, 2], float32
        Pixels inside, and all pixels, that show each Gaussian in the photos.
    drawn : array of shape [M, 2], float32
        The same of the object drawn alone, with a margin around the outline.

    Notes
    -----
    A Gaussian of the wall behind an object that reaches in front of it belongs to it by what surrounds it. Most of what
    the photos show of it lies outside. Of one below the floor, they show little or nothing, and it lies outside too.
    """
    beside = (shown[:, 0] < _MIN_INSIDE * shown[:, 1]) & (shown[:, 1] >= 1)
    hidden = (shown[:, 1] < _WELL_SEEN * drawn[:, 1]) & (drawn[:, 1] >= 1)
    return ~beside & ~(hidden & (drawn[:, 0] < _MIN_INSIDE * drawn[:, 1]))


def read_part(photos: DetailPhotos, camera: Camera, part: PinholeCamera, small: PinholeCamera) -> tuple[Pixels, Mask]:
    """Return the pixels of a part of a photo, and which pixels of the same part in the size of `small` are valid.

    Parameters
    ----------
    camera : Camera
        Of the photo.
    part : PinholeCamera
        A part of the undistorted photo, of h x w pixels.
    small : PinholeCamera
        The same part in the size of maps.

    Returns
    -------
    pixels : array of shape [h, w, 3], uint8, sRGB
    valid : array of shape [small.height, small.width], bool

    Raises
    ------
    PhotoError
        When the photo cannot be read.
    """
    full = training_pinhole(camera, max_side=_MAX_SIDE)
    source_side = math.ceil(max(camera.width, camera.height) * part.K[0, 0] / full.K[0, 0])
    source, source_valid = load_with_valid(
        photos.folder / camera.photo, photos.masks.get(camera.photo), max_side=source_side, over_black=True
    )
    pixels = np.ascontiguousarray(undistort(source, camera, part, interpolation="linear"))
    valid = np.ones((small.height, small.width), bool)
    if source_valid is not None:
        valid = undistort(source_valid.astype(np.float32), camera, small, interpolation="linear") > 1.0 - 1e-4
    return pixels, valid


def _map_camera(part: PinholeCamera) -> PinholeCamera:
    return part.scaled(min(1.0, math.sqrt(_MAP_PIXELS / (part.width * part.height))))
