"""Between a photo with its lens distortion and an ideal pinhole picture, both ways.

Pixel convention: the centre of the top left pixel is (0.5, 0.5), so a picture of a photo at another size is the same
frame scaled by the ratio of the sizes. A direction is (x, y) with the point (x, y, 1) in the camera's frame.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import CameraError
from ..scene import Camera, PinholeCamera

__all__ = [
    "covering_pinhole",
    "distort",
    "project",
    "read_camera_json",
    "shows",
    "training_pinhole",
    "undistort",
]

Float64 = NDArray[np.float64]
Pixels = TypeVar("Pixels", bound=np.generic)
Interpolation = Literal["linear", "nearest"]

# A pinhole picture grows without bound towards 180 degrees; these cap the directions it may hold per axis.
_TRAINING_REACH = np.tan(np.radians(60.0))
_COVERING_REACH = np.tan(np.radians(75.0))
_BORDER_SAMPLES = 257
# The photo's maps are computed on every 4th pixel and interpolated: a photo's distortion bends by less than
# 0.01 pixel within that.
_MAP_STEP = 4


def training_pinhole(camera: Camera, *, max_side: int) -> PinholeCamera:
    """Return an undistorted frame that shows only what the photo shows: no blank border.

    Parameters
    ----------
    camera : Camera
        The photo's camera.
    max_side : int
        Longest side at most, in pixels; the frame never has more pixels per angle than the photo's centre.

    Returns
    -------
    PinholeCamera
        With the photo's pose. Fisheye pictures are cut at 60 degrees off the axis.

    Raises
    ------
    CameraError
        When the lens parameters make no sense or the model cannot be a pinhole picture.
    """
    left, top, right, bottom = _border(camera, _TRAINING_REACH)
    inner = [float(values) for values in (left.max(), top.max(), right.min(), bottom.min())]
    inner = [max(inner[0], -_TRAINING_REACH), max(inner[1], -_TRAINING_REACH),
             min(inner[2], _TRAINING_REACH), min(inner[3], _TRAINING_REACH)]  # fmt: skip
    for _ in range(100):
        if inner[0] < inner[2] and inner[1] < inner[3] and _inside_photo(camera, inner):
            return _frame(camera, inner, max_side, np.floor)
        # A lens whose border is not convex: shrink about the optical axis until everything is covered.
        inner = [0.98 * value for value in inner]
    raise CameraError(_bad_lens(camera))


def covering_pinhole(camera: Camera, *, max_side: int | None = None) -> PinholeCamera:
    """Return an undistorted frame that covers every pixel of the photo (within 75 degrees off the axis).

    Parameters
    ----------
    camera : Camera
        The photo's camera.
    max_side : int, optional
        Longest side at most, in pixels; by default the resolution of the photo's centre.

    Returns
    -------
    PinholeCamera
        With the photo's pose; render it, then `distort` the picture back to the photo's frame.

    Raises
    ------
    CameraError
        When the lens parameters make no sense or the model cannot be a pinhole picture.
    """
    left, top, right, bottom = _border(camera, _COVERING_REACH)
    outer = [
        max(float(left.min()), -_COVERING_REACH),
        max(float(top.min()), -_COVERING_REACH),
        min(float(right.max()), _COVERING_REACH),
        min(float(bottom.max()), _COVERING_REACH),
    ]
    if not (outer[0] < outer[2] and outer[1] < outer[3]):
        raise CameraError(_bad_lens(camera))
    return _frame(camera, outer, max_side, np.ceil)


def undistort(
    image: NDArray[Pixels], camera: Camera, pinhole: PinholeCamera, *, interpolation: Interpolation = "linear"
) -> NDArray[Pixels]:
    """Return a picture of the photo as `pinhole` would have seen it.

    Parameters
    ----------
    image : array of shape [h, w] or [h, w, K], any dtype
        In the photo's frame at any size; a larger one is averaged down first (linear only).
    camera : Camera
        The photo's camera.
    pinhole : PinholeCamera
        Of the same pose, e.g. from `training_pinhole`.
    interpolation : {"linear", "nearest"}
        ``nearest`` keeps labels and booleans as they are. ``linear`` takes uint8, uint16, float32 and float64, and is
        exact to 1/32 pixel.

    Returns
    -------
    array of shape [pinhole.height, pinhole.width] or [..., K], dtype of `image`
        0 where the photo shows nothing.
    """
    x, y = _photo_positions(_lens_key(camera), _pinhole_key(pinhole))
    if interpolation == "linear":
        density = min(
            image.shape[1] / camera.width * _focals(camera)[0] / pinhole.K[0, 0],
            image.shape[0] / camera.height * _focals(camera)[1] / pinhole.K[1, 1],
        )
        image = _averaged_down(image, density)
    return _sample(image, x * (image.shape[1] / camera.width), y * (image.shape[0] / camera.height), interpolation)


def distort(
    image: NDArray[Pixels], pinhole: PinholeCamera, camera: Camera, *, interpolation: Interpolation = "linear"
) -> NDArray[Pixels]:
    """Return a pinhole picture bent back into the frame of the original photo.

    Parameters
    ----------
    image : array of shape [h, w] or [h, w, K], any dtype
        A picture of `pinhole` at any size.
    pinhole : PinholeCamera
        Of the same pose, e.g. from `covering_pinhole`.
    camera : Camera
        The photo's camera.
    interpolation : {"linear", "nearest"}
        See `undistort`.

    Returns
    -------
    array of shape [camera.height, camera.width] or [..., K], dtype of `image`
        0 where the pinhole picture shows nothing.
    """
    x, y = _pinhole_positions(_lens_key(camera), _pinhole_key(pinhole))
    if interpolation == "linear":
        density = min(
            image.shape[1] / pinhole.width * pinhole.K[0, 0] / _focals(camera)[0],
            image.shape[0] / pinhole.height * pinhole.K[1, 1] / _focals(camera)[1],
        )
        image = _averaged_down(image, density)
    return _sample(image, x * (image.shape[1] / pinhole.width), y * (image.shape[0] / pinhole.height), interpolation)


def project(camera: Camera, points: NDArray[np.floating[Any]]) -> tuple[Float64, Float64]:
    """Return where world points appear in the original photo.

    Parameters
    ----------
    camera : Camera
        The photo's camera.
    points : array of shape [N, 3]
        World positions.

    Returns
    -------
    pixels : array of shape [N, 2], float64
        x and y in original pixels, also outside the picture; NaN for points behind the camera and for directions
        beyond the lens model's turning point, where distant directions would fold back into the picture.
    depth : array of shape [N], float64
        Along the optical axis, in world units; negative behind the camera.
    """
    local = np.asarray(points, dtype=np.float64) @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    depth = local[:, 2]
    pixels = np.full((len(local), 2), np.nan)
    front = depth > 0.0
    if front.any():
        pixels[front] = _to_photo(_lens_key(camera), local[front])
    return pixels, depth


def shows(camera: Camera, point: NDArray[np.floating[Any]]) -> bool:
    """Return whether a world point, shape [3], lies in the picture of `camera`, before it."""
    pixels, depth = project(camera, np.asarray(point, np.float64)[None])
    x, y = pixels[0]
    return bool(depth[0] > 0 and 0 <= x < camera.width and 0 <= y < camera.height)


def read_camera_json(path: Path) -> PinholeCamera:
    """Return the camera in a JSON file with width, height, fx, fy, cx, cy and a world-to-camera ``viewmat`` (4 x 4).

    Raises
    ------
    CameraError
        When the file is missing, no JSON, lacks a key, or holds numbers that are no camera.
    """
    needed = ("width", "height", "fx", "fy", "cx", "cy", "viewmat")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CameraError(f"{path} cannot be read as a camera: {error}. It must be a JSON file.") from error
    missing = [key for key in needed if not isinstance(data, dict) or key not in data]
    if missing:
        raise CameraError(f"{path} is not a camera: it lacks {', '.join(missing)}.")
    try:
        width, height = int(data["width"]), int(data["height"])
        fx, fy, cx, cy = (float(data[key]) for key in ("fx", "fy", "cx", "cy"))
        viewmat = np.array(data["viewmat"], dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise CameraError(f"{path} is not a camera: {error}.") from error
    if width < 1 or height < 1 or not (fx > 0.0 and fy > 0.0) or not np.isfinite([fx, fy, cx, cy]).all():
        raise CameraError(f"{path} is not a camera: its size and focal lengths must be positive, finite numbers.")
    if viewmat.shape != (4, 4) or not np.isfinite(viewmat).all():
        raise CameraError(f"{path} is not a camera: `viewmat` must be 4 rows of 4 finite numbers.")
    rotation = viewmat[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0.0:
        raise CameraError(f"{path} is not a camera: the rotation in `viewmat` is scaled, skewed or mirrored.")
    if not np.allclose(viewmat[3], (0.0, 0.0, 0.0, 1.0), atol=1e-9):
        raise CameraError(f"{path} is not a camera: the last row of `viewmat` must be 0 0 0 1.")
    return PinholeCamera(viewmat, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), width, height)


# ---- the lens


@functools.lru_cache(maxsize=256)
def _lens_of(model: str, width: int, height: int, params: tuple[float, ...]) -> pycolmap.Camera:
    if model == "EQUIRECTANGULAR":
        raise CameraError("360 degree panoramas cannot be used as photos. Cut them into ordinary views first.")
    try:
        lens = pycolmap.Camera(model=model, width=width, height=height, params=list(params))
        valid = lens.verify_params() and np.isfinite(params).all() and lens.mean_focal_length() > 0.0
    except (ValueError, RuntimeError, TypeError) as error:
        raise CameraError(f"The lens model {model} with {len(params)} parameters is not one of COLMAP's.") from error
    if not valid:
        raise CameraError(f"The lens model {model} with the parameters {params} makes no sense.")
    return lens


def _lens(camera: Camera) -> pycolmap.Camera:
    return _lens_of(*_lens_key(camera))


_LensKey = tuple[str, int, int, tuple[float, ...]]
_PinholeKey = tuple[float, float, float, float, int, int]


def _lens_key(camera: Camera) -> _LensKey:
    return camera.model, camera.width, camera.height, camera.params


def _pinhole_key(pinhole: PinholeCamera) -> _PinholeKey:
    K = pinhole.K
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), pinhole.width, pinhole.height


def _focals(camera: Camera) -> tuple[float, float]:
    lens = _lens(camera)
    values = [camera.params[index] for index in lens.focal_length_idxs()]
    return values[0], values[-1]


def _bad_lens(camera: Camera) -> str:
    return f"The lens of {camera.photo} ({camera.model} {camera.params}) makes no sense and cannot be undistorted."


def _to_photo(lens_key: _LensKey, local: Float64) -> Float64:
    """Return pixels [N, 2] of points [N, 3] in front of the camera, NaN beyond the lens model's turning point."""
    pixels: Float64 = _lens_of(*lens_key).img_from_cam(np.ascontiguousarray(local))
    directions = local[:, :2] / local[:, 2:]
    angles, reaches = _turning_points(lens_key)
    reach = np.interp(np.arctan2(directions[:, 1], directions[:, 0]), angles, reaches)
    pixels[np.linalg.norm(directions, axis=1) > reach] = np.nan
    return pixels


def _from_photo(lens_key: _LensKey, pixels: Float64) -> Float64:
    """Return the directions [N, 2] of pixels [N, 2], NaN where the lens model has none in front of the camera."""
    directions: Float64 = _lens_of(*lens_key).cam_from_img(pixels)
    there = np.nan_to_num(np.concatenate([directions, np.ones((len(directions), 1))], axis=1))
    # Beyond 90 degrees a fisheye model gives the opposite direction; only the way back tells.
    with np.errstate(invalid="ignore"):
        true = np.linalg.norm(_to_photo(lens_key, there) - pixels, axis=1) < 0.1
    directions[~true] = np.nan
    return directions


@functools.lru_cache(maxsize=256)
def _turning_points(lens_key: _LensKey) -> tuple[Float64, Float64]:
    """Return angles [A] around the optical axis and how far off it [A] the lens model still leads outwards.

    A distortion polynomial turns back at some distance; what lies beyond would appear inside the picture again. The
    distance is found by walking outwards in steps of 0.1 degrees, up to 89 degrees off the axis.
    """
    lens = _lens_of(*lens_key)
    angles = np.linspace(-np.pi, np.pi, 65)
    distances = np.tan(np.radians(np.linspace(0.0, 89.0, 891)))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None] * distances[:, None]
    local = np.concatenate([directions, np.ones((*directions.shape[:2], 1))], axis=2)
    pixels = lens.img_from_cam(local.reshape(-1, 3)).reshape(*directions.shape)
    off_axis = np.linalg.norm(pixels - pixels[:, :1], axis=2)
    with np.errstate(invalid="ignore"):
        outwards = np.diff(off_axis, axis=1) > 0.0
    steps = np.where(outwards.all(axis=1), outwards.shape[1], np.argmin(outwards, axis=1))
    return angles, distances[steps]


def _border(camera: Camera, reach: float) -> tuple[Float64, Float64, Float64, Float64]:
    """Return x along the left, y along the top, x along the right, y along the bottom border of the photo.

    Border points that no direction leads to (beyond the turning point, or at 90 degrees and more) are left out; a
    border without any other points lies at `reach`.
    """
    w, h = float(camera.width), float(camera.height)
    along = np.linspace(0.0, 1.0, _BORDER_SAMPLES)
    zeros, ones = np.zeros_like(along), np.ones_like(along)
    sides = []
    for x, y, axis, beyond in (
        (zeros, along, 0, -reach),
        (along, zeros, 1, -reach),
        (ones, along, 0, reach),
        (along, ones, 1, reach),
    ):
        values = _from_photo(_lens_key(camera), np.stack([x * w, y * h], axis=1))[:, axis]
        values = values[np.isfinite(values)]
        sides.append(values if len(values) else np.array([beyond]))
    return sides[0], sides[1], sides[2], sides[3]


def _inside_photo(camera: Camera, box: list[float]) -> bool:
    """Return whether every direction on the border of `box` (left, top, right, bottom) falls into the photo."""
    along = np.linspace(0.0, 1.0, _BORDER_SAMPLES)
    x, y = box[0] + along * (box[2] - box[0]), box[1] + along * (box[3] - box[1])
    sides = [(x, np.full_like(x, edge)) for edge in (box[1], box[3])]
    sides += [(np.full_like(y, edge), y) for edge in (box[0], box[2])]
    border = np.concatenate([np.stack(side, axis=1) for side in sides])
    pixels = _to_photo(_lens_key(camera), np.concatenate([border, np.ones((len(border), 1))], axis=1))
    slack = 1e-3
    return bool(
        (pixels[:, 0] >= -slack).all()
        and (pixels[:, 1] >= -slack).all()
        and (pixels[:, 0] <= camera.width + slack).all()
        and (pixels[:, 1] <= camera.height + slack).all()
    )


def _frame(camera: Camera, box: list[float], max_side: int | None, whole: np.ufunc) -> PinholeCamera:
    """Return the pinhole frame of the directions in `box`; `whole` rounds its size to pixels."""
    fx, fy = _focals(camera)
    width, height = fx * (box[2] - box[0]), fy * (box[3] - box[1])
    longest = max(width, height)
    scale = 1.0 if max_side is None else min(1.0, max_side / longest)

    def pixels(size: float) -> int:
        # A size that is whole but for rounding must not lose or win a pixel.
        nearest = round(size)
        return max(1, nearest if abs(size - nearest) < 1e-3 else int(whole(size)))

    K = np.array([[fx * scale, 0.0, -box[0] * fx * scale], [0.0, fy * scale, -box[1] * fy * scale], [0.0, 0.0, 1.0]])
    return PinholeCamera(camera.viewmat, K, pixels(width * scale), pixels(height * scale))


# ---- the pictures


@functools.lru_cache(maxsize=4)
def _photo_positions(lens_key: _LensKey, pinhole_key: _PinholeKey) -> tuple[Float64, Float64]:
    """Return for each pixel of the pinhole picture its x and y [H, W] in the photo, NaN where there is none."""
    fx, fy, cx, cy, width, height = pinhole_key
    x, y = np.meshgrid((np.arange(width) + 0.5 - cx) / fx, (np.arange(height) + 0.5 - cy) / fy)
    pixels = _to_photo(lens_key, np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)).reshape(height, width, 2)
    return pixels[..., 0], pixels[..., 1]


@functools.lru_cache(maxsize=2)
def _pinhole_positions(lens_key: _LensKey, pinhole_key: _PinholeKey) -> tuple[Float64, Float64]:
    """Return for each pixel of the photo its x and y [H, W] in the pinhole picture, NaN where there is none."""
    _, photo_width, photo_height, _ = lens_key
    fx, fy, cx, cy, _, _ = pinhole_key
    # One step beyond the last pixel, so that every pixel lies between two.
    columns = np.arange(0, photo_width + _MAP_STEP, _MAP_STEP, dtype=np.float64)
    rows = np.arange(0, photo_height + _MAP_STEP, _MAP_STEP, dtype=np.float64)
    x, y = np.meshgrid(columns + 0.5, rows + 0.5)
    directions = _from_photo(lens_key, np.stack([x.ravel(), y.ravel()], axis=1)).reshape(len(rows), len(columns), 2)
    coarse = directions * (fx, fy) + (cx, cy)
    return _finer(coarse[..., 0], photo_width, photo_height), _finer(coarse[..., 1], photo_width, photo_height)


def _finer(coarse: Float64, width: int, height: int) -> Float64:
    """Return `coarse`, given at every `_MAP_STEP`-th pixel, at every pixel [height, width], linear in between."""
    steps = np.arange(_MAP_STEP) / _MAP_STEP

    def along_rows(values: Float64, count: int) -> Float64:
        between = values[:-1, None] + steps[None, :, None] * (values[1:] - values[:-1])[:, None]
        return between.reshape(-1, values.shape[1])[:count]

    return np.ascontiguousarray(along_rows(along_rows(coarse, height).T, width).T)


def _averaged_down(image: NDArray[Pixels], density: float) -> NDArray[Pixels]:
    """Return `image` made smaller when it has clearly more pixels than will be sampled: sampling alone would alias."""
    if density <= 1.2:
        return image
    size = (max(1, round(image.shape[1] / density)), max(1, round(image.shape[0] / density)))
    smaller = np.stack([cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in _planes(image)], axis=-1)
    return smaller.reshape(size[1], size[0], *image.shape[2:])


def _planes(image: NDArray[Pixels]) -> list[NDArray[Pixels]]:
    flat = image.reshape(image.shape[0], image.shape[1], -1)
    return [np.ascontiguousarray(flat[:, :, index]) for index in range(flat.shape[2])]


def _sample(image: NDArray[Pixels], x: Float64, y: Float64, interpolation: Interpolation) -> NDArray[Pixels]:
    """Return `image` at the positions (x, y), in its own pixels with centres at halves; 0 outside."""
    height, width = image.shape[:2]
    with np.errstate(invalid="ignore"):
        # A hair of slack: positions on the very border are inside but for rounding.
        inside = (x >= -1e-3) & (x <= width + 1e-3) & (y >= -1e-3) & (y <= height + 1e-3)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    if interpolation == "nearest":
        columns = np.clip(np.floor(x).astype(np.int64), 0, width - 1)
        rows = np.clip(np.floor(y).astype(np.int64), 0, height - 1)
        sampled = image[rows, columns]
    elif interpolation == "linear":
        map_x, map_y = (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)
        planes = [
            cv2.remap(plane, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for plane in _planes(image)
        ]
        sampled = np.stack(planes, axis=-1).reshape(*x.shape, *image.shape[2:])
    else:
        raise ValueError(f"interpolation must be 'linear' or 'nearest', got {interpolation!r}")
    sampled[~inside] = 0
    return sampled
