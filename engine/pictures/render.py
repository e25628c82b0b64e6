"""Rendering of pictures of a scene in the pixels of a photo (after EXIF rotation), or of a given pinhole camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32, normalized
from ..core.errors import ObjectError, SettingsError
from ..masks.settings import INSTANCE_COSINE
from ..rasterizer.settings import Backend
from ..scene import Camera, Gaussians, PinholeCamera
from .clusters import cluster_colors, find_clusters, principal_colors
from .scene import Scene
from .settings import VISIBLE_SHARE

DEPTH_STEPS_PER_UNIT = 1000
"""Grey values of a depth picture per unit of the normalised world. 0 means no surface, 65535 this depth or more."""

_MAX_FEATURE_SIDE = 1600
"""Longest side in pixels at which features are rendered, to limit the memory of 16 channels. The coloured picture is
resized to the photo."""

_MIN_COVERAGE = 0.5
"""Coverage above which a pixel of a depth, instance or click picture counts as covered."""

Subject = Literal["rgb", "mask", "depth", "features", "instances"]


def render_view(
    gaussians: Gaussians,
    camera: Camera | PinholeCamera,
    *,
    what: Subject = "rgb",
    members: NDArray[np.bool_] | None = None,
    click: tuple[float, float] | None = None,
    backend: Backend = "cpu",
) -> NDArray[Any]:
    """Return a picture of the scene or of one object.

    Parameters
    ----------
    camera : Camera or PinholeCamera
        With a photo's camera the picture has the photo's size and lens distortion.
    what : {"rgb", "mask", "depth", "features", "instances"}
        ``rgb``: colours over black, only of the object if `members` is given. ``mask``: pixels that show `members`,
        which the rest of the scene may occlude. ``depth``: mean depth of the visible Gaussians, in steps of
        1 / `DEPTH_STEPS_PER_UNIT`. ``features``: first three principal axes of the features. ``instances``: one colour
        for each cluster of features, black for pixels in none.
    members : bool array of shape [N], optional
        Gaussians of one object.
    click : (float, float), optional
        Pixel of the picture, with ``features`` or ``instances``. Pixels with a similar feature become white.
    backend : {"cpu", "gpu", "reference"}

    Returns
    -------
    array of shape [H, W, 3], uint8, for ``rgb``, ``features`` and ``instances``; [H, W], uint8 (0 or 255), for
    ``mask`` and with a click; [H, W], uint16, for ``depth``.

    Raises
    ------
    SettingsError
        For a mask without an object, and for a click outside of the picture or with another `what`.
    ObjectError
        If features are needed and the scene was trained without them, or `members` belongs to another scene.
    """
    if members is not None and len(members) != len(gaussians):
        raise ObjectError(
            f"The object was made for {len(members)} Gaussians, but the scene has {len(gaussians)}. Isolate it again."
        )
    if what in ("features", "instances") and gaussians.features is None:
        raise ObjectError("This scene was trained without segmentation features. Reconstruct it with objects wanted.")
    if click is not None and what not in ("features", "instances"):
        raise SettingsError(f"--click goes with `features` or `instances`, not with `{what}`.")
    if what == "mask":
        if members is None:
            raise SettingsError("A mask requires an object. Choose it with --object.")
        (mask,) = visible_masks(Scene(gaussians, backend=backend), camera, [members])
        return np.where(mask, np.uint8(255), np.uint8(0))
    shown = gaussians if members is None else gaussians[members]
    if what == "rgb":
        return _rgb(shown, camera, backend)
    if what == "depth":
        return _depth(shown, camera, backend)
    if click is not None:
        return click_mask(shown, camera, click, backend=backend)
    # Clusters are computed on the whole scene, so that a single object keeps its colour.
    return _feature_picture(shown, gaussians, camera, what, backend)


def click_mask(
    gaussians: Gaussians,
    camera: Camera | PinholeCamera,
    click: tuple[float, float],
    *,
    backend: Backend = "cpu",
) -> NDArray[np.uint8]:
    """Return the pixels with features similar to that of a given pixel, white on black.

    Parameters
    ----------
    gaussians : Gaussians
        A scene with features.
    camera : Camera or PinholeCamera
    click : (float, float)
        x, y in pixels of the picture; (0, 0) is its top left corner.
    backend : {"cpu", "gpu", "reference"}

    Returns
    -------
    array of shape [H, W], uint8
        255 where the cosine is at least `INSTANCE_COSINE` and more than half of the pixel is covered. All 0 if the
        clicked pixel is not covered.

    Raises
    ------
    SettingsError
        If the pixel is outside of the picture.
    """
    x, y = click
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise SettingsError(
            f"The click {x:g},{y:g} lies outside of the picture, {camera.width} x {camera.height} pixels."
        )
    frame = _frame(camera, max_side=_MAX_FEATURE_SIDE)
    rendered = Scene(gaussians, backend=backend).render(frame, channels=gaussians.features)
    unit = normalized(rendered.channels)
    column, row = _pixel_in_frame(click, frame, camera)
    similar = unit @ unit[row, column] >= INSTANCE_COSINE
    covered = rendered.alpha > _MIN_COVERAGE
    if not covered[row, column]:
        similar[:] = False
    picture = _to_photo((similar & covered).astype(np.float32), frame, camera)
    return np.where(picture > 0.5, np.uint8(255), np.uint8(0))


def visible_masks(
    scene: Scene, camera: Camera | PinholeCamera, members: Sequence[NDArray[np.bool_]]
) -> Iterator[NDArray[np.bool_]]:
    """Yield for each set of Gaussians where it makes up more than half of a pixel of the photo, bool [height, width].

    The same as `render_view` with ``what="mask"``, for several sets in one pass.
    """
    frame = _frame(camera)
    for share in scene.shares(frame, members):
        yield np.asarray(_to_photo(share, frame, camera) > VISIBLE_SHARE)


def _frame(camera: Camera | PinholeCamera, *, max_side: int | None = None) -> PinholeCamera:
    if isinstance(camera, PinholeCamera):
        return camera
    from ..cameras import covering_pinhole

    return covering_pinhole(camera, max_side=max_side)


def _to_photo(picture: Float32, frame: PinholeCamera, camera: Camera | PinholeCamera) -> Float32:
    """Resample `picture` from `frame` to the pixels of the photo."""
    if isinstance(camera, PinholeCamera):
        return picture
    from ..cameras import distort

    return np.asarray(distort(picture, frame, camera, interpolation="linear"), np.float32)


def _pixel_in_frame(
    click: tuple[float, float], frame: PinholeCamera, camera: Camera | PinholeCamera
) -> tuple[int, int]:
    """Return the column and row of `frame` that correspond to a pixel of the photo."""
    x, y = int(click[0]), int(click[1])
    if isinstance(camera, PinholeCamera):
        return x, y
    rows, columns = np.mgrid[: frame.height, : frame.width].astype(np.float32)
    position = _to_photo(np.stack([columns, rows], axis=-1), frame, camera)[y, x]
    column, row = np.rint(position).astype(int)
    return int(np.clip(column, 0, frame.width - 1)), int(np.clip(row, 0, frame.height - 1))


def _uint8(values: Float32) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)


def _rgb(gaussians: Gaussians, camera: Camera | PinholeCamera, backend: Backend) -> NDArray[np.uint8]:
    frame = _frame(camera)
    return _uint8(_to_photo(Scene(gaussians, backend=backend).render(frame, color=True).channels, frame, camera))


def _depth(gaussians: Gaussians, camera: Camera | PinholeCamera, backend: Backend) -> NDArray[np.uint16]:
    frame = _frame(camera)
    scene = Scene(gaussians, backend=backend)
    rendered = scene.render(frame, channels=scene.depth_of(frame)[:, None])
    # Both are resampled before the division, so that depths are not mixed with depths of uncovered pixels.
    blended, alpha = _to_photo(np.dstack([rendered.channels, rendered.alpha]), frame, camera).transpose(2, 0, 1)
    covered = alpha > _MIN_COVERAGE
    depth = np.divide(blended, alpha, out=np.zeros_like(blended), where=covered)
    steps = np.rint(np.clip(depth * DEPTH_STEPS_PER_UNIT, 1, 65535))
    return np.where(covered, steps, 0).astype(np.uint16)


def _feature_picture(
    shown: Gaussians,
    whole: Gaussians,
    camera: Camera | PinholeCamera,
    what: Literal["features", "instances"],
    backend: Backend,
) -> NDArray[np.uint8]:
    assert whole.features is not None
    frame = _frame(camera, max_side=_MAX_FEATURE_SIDE)
    rendered = Scene(shown, backend=backend).render(frame, channels=shown.features)
    unit = normalized(rendered.channels)
    if what == "features":
        basis, low, high = principal_colors(whole.features, whole.opacities)
        colors = np.clip((unit @ basis - low) / (high - low), 0, 1) * rendered.alpha[..., None]
    else:
        centers = find_clusters(whole.features, whole.opacities)
        colors = np.zeros((*unit.shape[:2], 3), np.float32)
        if len(centers):
            cosines = unit @ centers.T
            best = cosines.argmax(axis=-1)
            fits = (cosines.max(axis=-1) >= INSTANCE_COSINE) & (rendered.alpha > _MIN_COVERAGE)
            colors[fits] = cluster_colors(len(centers))[best[fits]]
    return _uint8(_to_photo(colors, frame, camera))
