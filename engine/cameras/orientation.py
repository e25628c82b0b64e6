"""Which way a given camera's picture was turned, compared with the upright photo: decided by what the photo shows.

Some programs apply the EXIF orientation of a photo, others place the picture as it is stored, and photos may have been
turned or saved anew since. Sizes exclude some orientations. Between the others, the colours of the model's points
decide: those of the pixels where the camera shows them agree for the right orientation only.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import CameraError, Cancelled, PhotoError
from ..core.events import StopCheck
from ..photos import load_pixels, stored_orientation
from ..scene import Camera, Lens, Photo, lens_pixels
from .model_reading import SparsePoints
from .reconstruction import camera_in_photo, is_scaled
from .turning import MIRROR, MIRRORED, ORIENTATIONS, turned_lens, turned_pixels, turned_size, turned_viewmat
from .undistortion import require_valid_lens

_LOG = logging.getLogger(__name__)

_SIDE = 320
"""Longest side of the photos in which colours are compared, pixels. Smaller than the details of points' colours."""
_MIN_POINTS = 24
"""Points with different colours that a photo must show for its colours to say anything."""
_CLEAR_FIT, _CLEAR_LEAD = 0.3, 0.15
"""Correlation of colours that the right orientation has at least, and its lead over the other ones. In the 8 photos of
`museum_room` with models of COLMAP, right ones have 0.63 to 0.87 and wrong ones -0.20 to 0.38, each at least 0.33
less."""
_N_SAMPLED = 6
"""Photos whose orientation seems to be certain of which the colours are compared nevertheless."""


@dataclass(frozen=True)
class GivenCamera:
    """A camera of a model with its photo.

    Attributes
    ----------
    photo : Photo
    name : str
        Of the picture in the model.
    viewmat : array of shape [4, 4], float64
        World-to-camera of the picture as the program saw it.
    lens_in : callable
        Returns the lens of a picture of this width and height.
    size : tuple of int or None
        Width and height of the picture; None where the model does not say it.
    seen : int array of shape [S]
        Indices of points that the picture shows; empty when the model does not say it.
    """

    photo: Photo
    name: str
    viewmat: Float64
    lens_in: Callable[[int, int], Lens]
    size: tuple[int, int] | None
    seen: NDArray[np.int64]

    def lens(self, orientation: int) -> Lens:
        """Return the lens of the picture as the program saw it, if `orientation` makes that upright."""
        lens = self.lens_in(*(self.size or turned_size(self.photo.width, self.photo.height, orientation)))
        require_valid_lens(lens)
        return lens

    def fits(self, orientation: int) -> bool:
        """Return whether the picture, made upright, can be the photo at another size."""
        if self.size is None:
            return True
        return is_scaled(turned_size(*self.size, orientation), (self.photo.width, self.photo.height))

    def upright(self, orientation: int) -> Camera:
        """Return the camera of the upright photo; for a mirrored orientation, in the mirrored world."""
        lens = require_valid_lens(turned_lens(self.lens(orientation), orientation))
        viewmat = turned_viewmat(self.viewmat, orientation)
        return camera_in_photo(self.photo.name, lens, self.photo.width, self.photo.height, viewmat)


@dataclass(frozen=True)
class OrientationChoice:
    """Orientations of given cameras.

    Attributes
    ----------
    chosen : list of int
        The orientation of each camera, an EXIF number; for cameras in `open` a guess.
    open : dict of int to tuple of int
        Cameras, by index, that may have several orientations between which nothing decides yet.
    """

    chosen: list[int]
    open: dict[int, tuple[int, ...]]


def choose_orientations(
    given: Sequence[GivenCamera], points: SparsePoints, folder: Path, model: Path, should_stop: StopCheck
) -> OrientationChoice:
    """Return which way the picture of each camera was turned.

    Parameters
    ----------
    folder : Path
        The photo folder.
    model : Path
        For messages.

    Raises
    ------
    CameraError
        When the picture of a camera cannot be its photo in any orientation.
    Cancelled
        When `should_stop` returned True.

    Notes
    -----
    An upright picture, or one as the file stores it, is believed without a comparison where only one of the two has the
    photo's shape; but if the colours of a sample of such photos refute that, those of all photos are compared. Photos
    whose own colours do not decide are taken as most others of the model are.
    """
    tags = [_tag(folder / camera.photo.name) for camera in given]
    fitting = [[o for o in ORIENTATIONS if camera.fits(o)] for camera in given]
    for camera, possible in zip(given, fitting, strict=True):
        if not possible:
            raise _wrong_shape(camera, model)
    likely = [
        [o for o in dict.fromkeys((1, tag)) if o in possible] for tag, possible in zip(tags, fitting, strict=True)
    ]
    chosen = [orientations[0] if orientations else 0 for orientations in likely]
    colors = _Colors(points, folder)
    certain = [index for index, orientations in enumerate(likely) if len(orientations) == 1]
    sample = certain[:: max(1, -(-len(certain) // _N_SAMPLED))] if colors.usable else []
    refuted = [index for index in sample if not colors.supports(given[index], chosen[index])]
    compared = range(len(given)) if refuted else [i for i, orientations in enumerate(likely) if len(orientations) != 1]
    undecided: dict[int, tuple[int, ...]] = {}
    for index in compared:
        if should_stop():
            raise Cancelled("Stopped while reading the cameras. Nothing was changed.")
        best = colors.best(given[index], fitting[index] if refuted or not likely[index] else likely[index])
        if best is not None:
            chosen[index] = best
        elif len(likely[index]) != 1:
            undecided[index] = tuple(likely[index] or fitting[index])
    _follow_others(chosen, tags, undecided, [index for index in compared if index not in undecided])
    return OrientationChoice(chosen, undecided)


def upright_cameras(
    given: Sequence[GivenCamera], chosen: Sequence[int], points: SparsePoints, model: Path
) -> tuple[list[Camera], SparsePoints]:
    """Return the cameras of the upright photos, and the points in their world, which is mirrored where pictures were.

    Raises
    ------
    CameraError
        When some pictures are mirrored and others are not: they cannot belong to one world.
    """
    mirrored = [orientation in MIRRORED for orientation in chosen]
    if any(mirrored) and not all(mirrored):
        one, other = given[mirrored.index(True)], given[mirrored.index(False)]
        raise CameraError(
            f"The cameras in {model} contradict each other: that of {one.photo.name} is for a mirrored picture, that "
            f"of {other.photo.name} is not. Save the mirrored photos as they should look, and place them again."
        )
    if mirrored and all(mirrored):
        _LOG.warning("All pictures of %s are mirrored; its world is mirrored back.", model)
        points = SparsePoints(points.positions @ MIRROR, points.colors, points.reprojection_error)
    return [camera.upright(orientation) for camera, orientation in zip(given, chosen, strict=True)], points


def _tag(file: Path) -> int:
    try:
        return stored_orientation(file)
    except PhotoError as error:
        # The stages that use its pixels report the photo.
        _LOG.warning("The orientation of a photo is not known: %s", error)
        return 1


def _wrong_shape(camera: GivenCamera, model: Path) -> CameraError:
    assert camera.size is not None
    return CameraError(
        f"The camera of {camera.photo.name} in {model} is for {camera.size[0]} x {camera.size[1]} pixels, the photo "
        f"has {camera.photo.width} x {camera.photo.height}: it was made from cropped or other pictures. Choose those "
        "pictures as the photo folder."
    )


def _follow_others(
    chosen: list[int], tags: Sequence[int], undecided: dict[int, tuple[int, ...]], decided: Sequence[int]
) -> None:
    """Decide photos between upright and stored as all decided photos of a tag were decided; changes the arguments."""
    stored = [index for index in decided if tags[index] != 1 and chosen[index] == tags[index]]
    upright = [index for index in decided if tags[index] != 1 and chosen[index] == 1]
    if bool(stored) == bool(upright):
        return
    for index, orientations in list(undecided.items()):
        wanted = tags[index] if stored else 1
        if wanted in orientations:
            chosen[index] = wanted
            del undecided[index]


class _Colors:
    """Compares the colours of the model's points with the pixels of the photos, which are kept while needed."""

    def __init__(self, points: SparsePoints, folder: Path) -> None:
        self._positions, self._colors, self._folder = points.positions, points.colors.astype(np.float64), folder
        self.usable = len(points.positions) >= _MIN_POINTS and bool(points.colors.std(axis=0).max() > 1.0)

    def supports(self, camera: GivenCamera, orientation: int) -> bool:
        """Return False when the colours clearly refute an orientation."""
        best = self.best(camera, [o for o in ORIENTATIONS if camera.fits(o)])
        return best is None or best == orientation

    def best(self, camera: GivenCamera, orientations: Sequence[int]) -> int | None:
        """Return the orientation that the colours clearly support; None without one."""
        if not self.usable or len(orientations) < 2:
            return None
        try:
            pixels = load_pixels(self._folder / camera.photo.name, max_side=_SIDE).astype(np.float64)
        except PhotoError as error:
            _LOG.warning("The colours of a photo cannot be compared: %s", error)
            return None
        fits = sorted(((self._fit(camera, o, pixels), o) for o in orientations), reverse=True)
        (fit, best), (next_fit, _) = fits[:2]
        return best if fit >= _CLEAR_FIT and fit - next_fit >= _CLEAR_LEAD else None

    def _fit(self, camera: GivenCamera, orientation: int, pixels: Float64) -> float:
        """Return the correlation of points' colours and pixels, -1 to 1; -1 when too few points are shown."""
        lens = camera.lens(orientation)
        shown = camera.seen if len(camera.seen) >= _MIN_POINTS else np.arange(len(self._positions))
        local = self._positions[shown] @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
        front = local[:, 2] > 0.0
        at = turned_pixels(lens_pixels(lens, local[front, :2] / local[front, 2:]), lens.width, lens.height, orientation)
        size = turned_size(lens.width, lens.height, orientation)
        at = at / size * (pixels.shape[1], pixels.shape[0])
        with np.errstate(invalid="ignore"):
            inside = ((at >= 0) & (at < (pixels.shape[1], pixels.shape[0]))).all(axis=1)
        if inside.sum() < _MIN_POINTS:
            return -1.0
        x, y = at[inside].astype(int).T
        found, known = pixels[y, x], self._colors[shown[front][inside]]
        found, known = found - found.mean(axis=0), known - known.mean(axis=0)
        norm = float(np.sqrt((found**2).sum() * (known**2).sum()))
        return float((found * known).sum()) / norm if norm > 0.0 else -1.0
