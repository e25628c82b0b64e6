"""Resampling between a photo with lens distortion and an ideal pinhole picture, in both directions.

Pixel convention: the centre of the top left pixel is (0.5, 0.5), so the frame of a resized copy of a photo is the
photo's frame, scaled by the ratio of the sizes. A direction is (x, y) for the point (x, y, 1) in the camera's frame
(x right, y down, z forward).

`engine.scene` projects directions to pixels; pycolmap inverts that projection and validates the lens parameters here.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import CameraError
from ..core.files import parse_json, read_json
from ..scene import Camera, Lens, PinholeCamera, focal_and_center, is_rotation, lens_pixels
from .colmap import pycolmap

Pixels = TypeVar("Pixels", bound=np.generic)
Interpolation = Literal["linear", "nearest"]

# A pinhole picture grows without bound towards 180 degrees; these limit its directions along each axis.
_MAX_TRAINING_DIRECTION = np.tan(np.radians(60.0))
_MAX_COVERING_DIRECTION = np.tan(np.radians(75.0))
_BORDER_SAMPLES = 257
_MAP_STEP = 4
"""Pixels between computed positions of a photo's map; it is linear in between, with an error below 0.01 pixel."""
_BORDER_TOLERANCE = 1e-3
"""Pixels. Positions on the border of a picture are inside it in spite of rounding."""
_INVERSION_TOLERANCE = 0.1
"""Pixels. A direction whose projection is further than this from the pixel it was computed from is wrong."""


def training_pinhole(camera: Camera, *, max_side: int) -> PinholeCamera:
    """Return an undistorted frame that lies inside the photo, so that its picture has no blank border.

    Parameters
    ----------
    max_side : int
        Maximum length of the longest side in pixels. The frame never has more pixels per angle than the photo's centre.

    Returns
    -------
    PinholeCamera
        With the photo's pose. Fisheye pictures are cropped to 60 degrees off the axis.

    Raises
    ------
    CameraError
        When the lens parameters are invalid or the model has no pinhole picture.
    """
    left, top, right, bottom = _border(camera, _MAX_TRAINING_DIRECTION)
    inner = [float(values) for values in (left.max(), top.max(), right.min(), bottom.min())]
    limit = _MAX_TRAINING_DIRECTION
    inner = [max(inner[0], -limit), max(inner[1], -limit), min(inner[2], limit), min(inner[3], limit)]
    for _ in range(100):
        if inner[0] < inner[2] and inner[1] < inner[3] and _inside_photo(camera, inner):
            return _frame(camera, inner, max_side, np.floor)
        # The border of this lens is not convex: shrink the frame about the optical axis until the photo covers it.
        inner = [0.98 * value for value in inner]
    raise CameraError(_invalid_lens_message(camera))


def covering_pinhole(camera: Camera, *, max_side: int | None = None) -> PinholeCamera:
    """Return an undistorted frame that covers every pixel of the photo (within 75 degrees off the axis).

    Parameters
    ----------
    max_side : int, optional
        Maximum length of the longest side in pixels; by default the resolution of the photo's centre.

    Returns
    -------
    PinholeCamera
        With the photo's pose. `distort` maps its rendered picture to the photo's frame.

    Raises
    ------
    CameraError
        When the lens parameters are invalid or the model has no pinhole picture.
    """
    left, top, right, bottom = _border(camera, _MAX_COVERING_DIRECTION)
    outer = [
        max(float(left.min()), -_MAX_COVERING_DIRECTION),
        max(float(top.min()), -_MAX_COVERING_DIRECTION),
        min(float(right.max()), _MAX_COVERING_DIRECTION),
        min(float(bottom.max()), _MAX_COVERING_DIRECTION),
    ]
    if not (outer[0] < outer[2] and outer[1] < outer[3]):
        raise CameraError(_invalid_lens_message(camera))
    return _frame(camera, outer, max_side, np.ceil)


def undistort(
    image: NDArray[Pixels], camera: Camera, pinhole: PinholeCamera, *, interpolation: Interpolation = "linear"
) -> NDArray[Pixels]:
    """Return a picture of the photo, resampled to the frame of `pinhole`.

    Parameters
    ----------
    image : array of shape [h, w] or [h, w, K], any dtype
        In the photo's frame at any size. With linear interpolation a larger picture is first averaged down.
    camera : Camera
        Camera of the photo.
    pinhole : PinholeCamera
        Frame with the same pose, e.g. from `training_pinhole`.
    interpolation : {"linear", "nearest"}
        ``nearest`` keeps labels and booleans. ``linear`` accepts uint8, uint16, float32 and float64, and resolves
        positions to 1/32 pixel.

    Returns
    -------
    array of shape [pinhole.height, pinhole.width] or [..., K], dtype of `image`
        0 outside the photo.
    """
    x, y = _photo_positions(camera.lens, _pinhole_key(pinhole))
    if interpolation == "linear":
        fx, fy, _, _ = focal_and_center(camera)
        density = min(
            image.shape[1] / camera.width * fx / pinhole.K[0, 0],
            image.shape[0] / camera.height * fy / pinhole.K[1, 1],
        )
        image = _averaged_down(image, density)
    return _sample(image, x * (image.shape[1] / camera.width), y * (image.shape[0] / camera.height), interpolation)


def distort(
    image: NDArray[Pixels], pinhole: PinholeCamera, camera: Camera, *, interpolation: Interpolation = "linear"
) -> NDArray[Pixels]:
    """Return a pinhole picture, resampled to the frame of the original photo.

    Parameters
    ----------
    image : array of shape [h, w] or [h, w, K], any dtype
        Picture of `pinhole` at any size.
    pinhole : PinholeCamera
        Frame with the same pose, e.g. from `covering_pinhole`.
    camera : Camera
        Camera of the photo.
    interpolation : {"linear", "nearest"}
        See `undistort`.

    Returns
    -------
    array of shape [camera.height, camera.width] or [..., K], dtype of `image`
        0 outside the pinhole picture.
    """
    x, y = _pinhole_positions(camera.lens, _pinhole_key(pinhole))
    if interpolation == "linear":
        fx, fy, _, _ = focal_and_center(camera)
        density = min(
            image.shape[1] / pinhole.width * pinhole.K[0, 0] / fx,
            image.shape[0] / pinhole.height * pinhole.K[1, 1] / fy,
        )
        image = _averaged_down(image, density)
    return _sample(image, x * (image.shape[1] / pinhole.width), y * (image.shape[0] / pinhole.height), interpolation)


def project(camera: Camera, points: NDArray[np.floating[Any]]) -> tuple[Float64, Float64]:
    """Return where world points appear in the original photo.

    Parameters
    ----------
    points : array of shape [N, 3]
        World positions.

    Returns
    -------
    pixels : array of shape [N, 2], float64
        x and y in pixels of the photo, also outside the photo; NaN for points behind the camera and beyond the turning
        point of the lens model, where distant directions would appear inside the photo again.
    depth : array of shape [N], float64
        Along the optical axis, in world units; negative behind the camera.
    """
    local = np.asarray(points, dtype=np.float64) @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    depth = local[:, 2]
    pixels = np.full((len(local), 2), np.nan)
    in_front = depth > 0.0
    if in_front.any():
        pixels[in_front] = _pixels(camera.lens, local[in_front, :2] / local[in_front, 2:])
    return pixels, depth


def is_point_visible(camera: Camera, point: NDArray[np.floating[Any]]) -> bool:
    """Return whether a world point, shape [3], is in front of `camera` and inside its picture."""
    pixels, depth = project(camera, np.asarray(point, np.float64)[None])
    x, y = pixels[0]
    return bool(depth[0] > 0 and 0 <= x < camera.width and 0 <= y < camera.height)


_CAMERA_SCHEMA = {
    **dict.fromkeys(("width", "height"), int),
    **dict.fromkeys(("fx", "fy", "cx", "cy"), float),
    "viewmat": [[float]],
}
_CAMERA_ADVICE = "A camera has width, height, fx, fy, cx, cy and a viewmat of 4 x 4 numbers."


def read_camera_json(path: Path) -> PinholeCamera:
    """Return the camera in a JSON file with width, height, fx, fy, cx, cy and a ``viewmat`` of 4 x 4 numbers.

    Lens values are in pixels; ``viewmat`` is world-to-camera for the normalised world, x right, y down, z forward.

    Raises
    ------
    CameraError
        When the numbers are not a camera.
    FormatError
        When the file is missing, is not JSON or lacks a key.
    """
    return _pinhole_of(read_json(path, _CAMERA_SCHEMA, advice=_CAMERA_ADVICE), str(path))


def parse_camera_json(text: str) -> PinholeCamera:
    """Return the camera in a JSON text; content and errors as of `read_camera_json`."""
    return _pinhole_of(parse_json(text, _CAMERA_SCHEMA, source="The camera", advice=_CAMERA_ADVICE), "the given JSON")


def _pinhole_of(data: dict[str, Any], path: str) -> PinholeCamera:
    width, height = data["width"], data["height"]
    fx, fy, cx, cy = (float(data[key]) for key in ("fx", "fy", "cx", "cy"))
    if [len(row) for row in data["viewmat"]] != [4, 4, 4, 4]:
        raise CameraError(f"{path} is not a camera: `viewmat` must be 4 rows of 4 finite numbers.")
    viewmat = np.array(data["viewmat"], dtype=np.float64)
    if width < 1 or height < 1 or not (fx > 0.0 and fy > 0.0):
        raise CameraError(f"{path} is not a camera: its size and focal lengths must be positive.")
    if not is_rotation(viewmat[:3, :3]):
        raise CameraError(f"{path} is not a camera: the rotation in `viewmat` is scaled, skewed or mirrored.")
    if not np.allclose(viewmat[3], (0.0, 0.0, 0.0, 1.0), atol=1e-9):
        raise CameraError(f"{path} is not a camera: the last row of `viewmat` must be 0 0 0 1.")
    return PinholeCamera(viewmat, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), width, height)


# ---- the lens


@functools.lru_cache(maxsize=256)
def require_valid_lens(lens: Lens) -> pycolmap.Camera:
    """Return the pycolmap camera of a lens; raise `CameraError` when its parameters are invalid."""
    model, width, height, params = lens
    if model == "EQUIRECTANGULAR":
        raise CameraError("360 degree panoramas cannot be used as photos. Cut them into ordinary views first.")
    try:
        camera = pycolmap.Camera(model=model, width=width, height=height, params=list(params))
        valid = camera.verify_params() and np.isfinite(params).all() and camera.mean_focal_length() > 0.0
    except (ValueError, RuntimeError, TypeError) as error:
        raise CameraError(f"The lens model {model} with {len(params)} parameters is not one of COLMAP's.") from error
    if not valid:
        raise CameraError(f"The lens model {model} with the parameters {params} is invalid.")
    return camera


_PinholeKey = tuple[float, float, float, float, int, int]


def _pinhole_key(pinhole: PinholeCamera) -> _PinholeKey:
    K = pinhole.K
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), pinhole.width, pinhole.height


def _invalid_lens_message(camera: Camera) -> str:
    return f"The lens of {camera.photo} ({camera.model} {camera.params}) is invalid and cannot be undistorted."


def _pixels(lens: Lens, directions: Float64) -> Float64:
    """Return pixels [N, 2] of directions [N, 2], NaN beyond the lens model's turning point."""
    require_valid_lens(lens)
    return lens_pixels(lens, directions)


def _directions(lens: Lens, pixels: Float64) -> Float64:
    """Return directions [N, 2] of pixels [N, 2], NaN where the lens model has none in front of the camera."""
    directions: Float64 = require_valid_lens(lens).cam_from_img(pixels)
    # Beyond 90 degrees a fisheye model gives the opposite direction, which only its projection reveals.
    with np.errstate(invalid="ignore"):
        error = np.linalg.norm(_pixels(lens, np.nan_to_num(directions)) - pixels, axis=1)
        directions[~(error < _INVERSION_TOLERANCE)] = np.nan
    return directions


def _border(camera: Camera, limit: float) -> tuple[Float64, Float64, Float64, Float64]:
    """Return x along the left, y along the top, x along the right, y along the bottom border of the photo.

    Border points without a direction (beyond the turning point, or at 90 degrees and more) are omitted; a border
    without any point is placed at `limit`.
    """
    w, h = float(camera.width), float(camera.height)
    along = np.linspace(0.0, 1.0, _BORDER_SAMPLES)
    zeros, ones = np.zeros_like(along), np.ones_like(along)
    sides = []
    for x, y, axis, default in (
        (zeros, along, 0, -limit),
        (along, zeros, 1, -limit),
        (ones, along, 0, limit),
        (along, ones, 1, limit),
    ):
        values = _directions(camera.lens, np.stack([x * w, y * h], axis=1))[:, axis]
        values = values[np.isfinite(values)]
        sides.append(values if len(values) else np.array([default]))
    return sides[0], sides[1], sides[2], sides[3]


def _inside_photo(camera: Camera, box: list[float]) -> bool:
    """Return whether every direction on the border of `box` (left, top, right, bottom) lies in the photo."""
    along = np.linspace(0.0, 1.0, _BORDER_SAMPLES)
    x, y = box[0] + along * (box[2] - box[0]), box[1] + along * (box[3] - box[1])
    sides = [(x, np.full_like(x, edge)) for edge in (box[1], box[3])]
    sides += [(np.full_like(y, edge), y) for edge in (box[0], box[2])]
    border = np.concatenate([np.stack(side, axis=1) for side in sides])
    pixels = _pixels(camera.lens, border)
    slack = _BORDER_TOLERANCE
    return bool(((pixels >= -slack) & (pixels <= np.array([camera.width, camera.height]) + slack)).all())


def _frame(camera: Camera, box: list[float], max_side: int | None, rounding: np.ufunc) -> PinholeCamera:
    """Return the pinhole frame of the directions in `box`; `rounding` rounds its size to pixels."""
    fx, fy, _, _ = focal_and_center(camera)
    width, height = fx * (box[2] - box[0]), fy * (box[3] - box[1])
    longest = max(width, height)
    scale = 1.0 if max_side is None else min(1.0, max_side / longest)

    def pixels(size: float) -> int:
        # Rounding errors must not add or remove a pixel.
        nearest = round(size)
        return max(1, nearest if abs(size - nearest) < 1e-3 else int(rounding(size)))

    K = np.array([[fx * scale, 0.0, -box[0] * fx * scale], [0.0, fy * scale, -box[1] * fy * scale], [0.0, 0.0, 1.0]])
    return PinholeCamera(camera.viewmat, K, pixels(width * scale), pixels(height * scale))


# ---- the pictures


@functools.lru_cache(maxsize=4)
def _photo_positions(lens: Lens, pinhole_key: _PinholeKey) -> tuple[Float64, Float64]:
    """Return x and y [H, W] in the photo of each pixel of the pinhole picture, NaN where it has none."""
    fx, fy, cx, cy, width, height = pinhole_key
    x, y = np.meshgrid((np.arange(width) + 0.5 - cx) / fx, (np.arange(height) + 0.5 - cy) / fy)
    pixels = _pixels(lens, np.stack([x.ravel(), y.ravel()], axis=1)).reshape(height, width, 2)
    return pixels[..., 0], pixels[..., 1]


@functools.lru_cache(maxsize=2)
def _pinhole_positions(lens: Lens, pinhole_key: _PinholeKey) -> tuple[Float64, Float64]:
    """Return x and y [H, W] in the pinhole picture of each pixel of the photo, NaN where it has none."""
    photo_width, photo_height = lens.width, lens.height
    fx, fy, cx, cy, _, _ = pinhole_key
    # One step beyond the last pixel, so that every pixel lies between two positions.
    columns = np.arange(0, photo_width + _MAP_STEP, _MAP_STEP, dtype=np.float64)
    rows = np.arange(0, photo_height + _MAP_STEP, _MAP_STEP, dtype=np.float64)
    x, y = np.meshgrid(columns + 0.5, rows + 0.5)
    directions = _directions(lens, np.stack([x.ravel(), y.ravel()], axis=1)).reshape(len(rows), len(columns), 2)
    coarse = directions * (fx, fy) + (cx, cy)
    return _interpolate_map(coarse[..., 0], photo_width, photo_height), _interpolate_map(
        coarse[..., 1], photo_width, photo_height
    )


def _interpolate_map(coarse: Float64, width: int, height: int) -> Float64:
    """Return the map `coarse`, given at every `_MAP_STEP`-th pixel, at every pixel [height, width]."""
    steps = np.arange(_MAP_STEP) / _MAP_STEP

    def along_rows(values: Float64, count: int) -> Float64:
        between = values[:-1, None] + steps[None, :, None] * (values[1:] - values[:-1])[:, None]
        return between.reshape(-1, values.shape[1])[:count]

    return np.ascontiguousarray(along_rows(along_rows(coarse, height).T, width).T)


def _averaged_down(image: NDArray[Pixels], density: float) -> NDArray[Pixels]:
    """Return `image` averaged down when it has more than 1.2 times the sampled pixels per side, to prevent aliasing."""
    if density <= 1.2:
        return image
    size = (max(1, round(image.shape[1] / density)), max(1, round(image.shape[0] / density)))
    smaller = np.stack([cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in _planes(image)], axis=-1)
    return smaller.reshape(size[1], size[0], *image.shape[2:])


def _planes(image: NDArray[Pixels]) -> list[NDArray[Pixels]]:
    flat = image.reshape(image.shape[0], image.shape[1], -1)
    return [np.ascontiguousarray(flat[:, :, index]) for index in range(flat.shape[2])]


def _sample(image: NDArray[Pixels], x: Float64, y: Float64, interpolation: Interpolation) -> NDArray[Pixels]:
    """Return `image` at the positions (x, y) in its pixels, whose centres are at 0.5; 0 outside."""
    height, width = image.shape[:2]
    with np.errstate(invalid="ignore"):
        slack = _BORDER_TOLERANCE
        inside = (x >= -slack) & (x <= width + slack) & (y >= -slack) & (y <= height + slack)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    if interpolation == "nearest":
        columns = np.clip(np.floor(x).astype(np.int64), 0, width - 1)
        rows = np.clip(np.floor(y).astype(np.int64), 0, height - 1)
        sampled = image[rows, columns]
    else:
        map_x, map_y = (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)
        planes = [
            cv2.remap(plane, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for plane in _planes(image)
        ]
        sampled = np.stack(planes, axis=-1).reshape(*x.shape, *image.shape[2:])
    sampled[~inside] = 0
    return sampled
