"""Pictures that are no ordinary view through a lens: panoramas, round fisheye pictures, screenshots.

Structure from motion places them too, at wrong positions, so they must be known before.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..core.arrays import Float32
from ..scene import FISHEYE_LENS
from .exif import MAKE, MODEL, read_exif

Circle = tuple[float, float, float]
"""Centre and radius as shares of the shorter side, the centre relative to that of the picture."""

_PANORAMA = "It is a 360 degree panorama, which cannot be used as a photo. Cut it into ordinary views first."
_STITCHED = "It is a panorama that was put together from several photos. Use those photos instead."
_TWO_CIRCLES = (
    "It is the unfinished picture of a 360 degree camera: two round halves. Export it in the camera's program and cut "
    "it into ordinary views."
)
_SCREENSHOT = "It is a screenshot. Use the photo that it shows instead."
FISHEYE_PICTURE = (
    "It is a fisheye picture, round with black corners, which the usual lens model does not describe. Choose a fisheye "
    f"lens (--lens {FISHEYE_LENS}), or turn it into an ordinary view first."
)

_PROJECTION = re.compile(rb"GPano:ProjectionType\s*(?:=\s*[\"']|>)\s*(\w+)", re.IGNORECASE)
_XMP_KEYS = ("xmp", "XML:com.adobe.xmp")
_XMP_SCREENSHOT = re.compile(rb"UserComment.{0,200}?Screenshot", re.DOTALL)
_MAX_XMP_BYTES = 1 << 20
_CUSTOM_RENDERED, _USER_COMMENT, _FOCAL_LENGTH_35MM = 0xA401, 0x9286, 0xA405
_APPLE_PANORAMA = 6
"""Value of CustomRendered for a panorama, as Apple's cameras write it."""
_SCREENSHOT_NAMES = (
    "screenshot", "screen shot", "bildschirmfoto", "capture d", "captura de pantalla", "captura de tela",
    "captura de ecrã", "schermafbeelding", "schermata", "skärmavbild", "skjermbilde", "skærmbillede", "näyttökuva",
    "zrzut ekranu", "снимок экрана", "スクリーンショット", "스크린샷", "截屏", "屏幕截图", "螢幕截圖",
)  # fmt: skip
"""How names of screenshots begin, as phones and computers give them."""

_MIN_EDGE_TEXTURE = 1.5  # of 255 levels; a plain backdrop wraps around as well as a panorama
_MIN_WRAP = 0.5  # correlation of the two edges, which show neighbouring columns of the world
_MAX_JUMP = 3.0  # difference of the two edges, in differences of neighbouring columns
_MAX_POLE = 0.4  # the rows of the poles are one point of the world, stretched
_DARK = 20.0  # of 255 levels, above the noise of an unlit corner
_CORNER = 0.04  # side of a corner in shorter sides
_N_RAYS = 180
_MIN_RAYS = 40  # at which the edge of the circle lies inside of the picture
_MAX_RESIDUAL = 0.012  # of the radius; the edge of a lens is a circle, that of an object is not
_MIN_RADIUS, _MAX_OFF_CENTRE = 0.42, 0.08  # the circle of a lens fills the picture
_MAX_APART = 0.015  # pictures of one lens have the same circle
_MIN_LIT = 0.6  # share of the circle that is not black
_NARROW = 0.75  # focal length over the shorter side; no fisheye lens is so long


def unusual_picture(image: Image.Image, name: str, gray: Float32) -> str | None:
    """Return why a picture is no ordinary view, as a sentence; None where it may be one.

    Parameters
    ----------
    image : Image
        The decoded picture, for what its file says about it.
    name : str
        Its name; screenshots of some systems are known by it, where no camera is stated.
    gray : array of shape [h, w], float32
        Its brightness from 0 to 255, upright and reduced.
    """
    xmp = _xmp(image.info)
    projection = _PROJECTION.search(xmp)
    if projection is not None and projection[1].lower() != b"rectilinear":
        return _PANORAMA
    exif = read_exif(image)
    make = str(exif.get(MAKE, ""))
    if make.startswith("Apple") and exif.get(_CUSTOM_RENDERED) == _APPLE_PANORAMA:
        return _STITCHED
    has_camera = bool(make or exif.get(MODEL))
    comment = exif.get(_USER_COMMENT)
    text = comment.decode("latin-1") if isinstance(comment, bytes) else str(comment)
    if "Screenshot" in text or _XMP_SCREENSHOT.search(xmp) or (not has_camera and _is_named_so(name)):
        return _SCREENSHOT
    if not exif.get(_FOCAL_LENGTH_35MM) and _is_twice_as_wide(gray):
        if _wraps_around(gray):
            return _PANORAMA
        half = gray.shape[1] // 2
        if circle_of(gray[:, :half]) and circle_of(gray[:, half:]):
            return _TWO_CIRCLES
    return None


def circle_of(gray: Float32) -> Circle | None:
    """Return the circle that holds all light of a picture, as a round fisheye lens gives it; None for other pictures.

    Parameters
    ----------
    gray : array of shape [h, w], float32
        Brightness from 0 to 255.
    """
    height, width = gray.shape
    short = min(height, width)
    corner = max(2, round(_CORNER * short))
    corners = (gray[:corner, :corner], gray[:corner, -corner:], gray[-corner:, :corner], gray[-corner:, -corner:])
    if any(float(np.percentile(one, 95)) > _DARK for one in corners):
        return None
    lit = gray > _DARK
    points = _outermost(lit)
    if len(points) < _MIN_RAYS:
        return None
    # A least-squares circle, twice: dark parts of the scene at the edge give points inside of it.
    keep = np.ones(len(points), bool)
    for _ in range(4):
        if keep.sum() < _MIN_RAYS:
            return None
        x, y, radius = _fitted(points[keep])
        distance = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        keep = np.abs(distance) < max(_MAX_RESIDUAL * radius * 2, 2.5 * float(np.median(np.abs(distance))))
    residual = float(np.sqrt(np.mean(distance[keep] ** 2)))
    share = keep.mean()
    centre = (width - 1) / 2, (height - 1) / 2
    off = math.hypot(x - centre[0], y - centre[1])
    if residual > max(_MAX_RESIDUAL * radius, 0.7) or share < 0.7:
        return None
    if not _MIN_RADIUS * short <= radius or off > _MAX_OFF_CENTRE * short:
        return None
    rows, columns = np.mgrid[:height, :width]
    from_centre = np.hypot(columns - x, rows - y)
    inside, outside = lit[from_centre < 0.97 * radius], lit[from_centre > 1.04 * radius]
    if inside.mean() < _MIN_LIT or outside.mean() > 0.01:
        return None
    return (x - centre[0]) / short, (y - centre[1]) / short, radius / short


def fisheye_photos(circles: Sequence[Circle | None], focals: Sequence[float | None]) -> list[bool]:
    """Return for each photo whether it is a round fisheye picture: another photo of the set has the same circle.

    Parameters
    ----------
    circles : sequence
        As of `circle_of`. One alone may be a round object on a black ground.
    focals : sequence of float or None
        Focal length from EXIF over the shorter side; None where it is unknown.
    """
    candidates = [
        circle if circle is not None and (focal is None or focal < _NARROW) else None
        for circle, focal in zip(circles, focals, strict=True)
    ]
    return [
        one is not None
        and any(
            other is not None and index != at and max(abs(a - b) for a, b in zip(one, other, strict=True)) < _MAX_APART
            for at, other in enumerate(candidates)
        )
        for index, one in enumerate(candidates)
    ]


def _xmp(info: dict[Any, Any]) -> bytes:
    text = next((info[key] for key in _XMP_KEYS if key in info), b"")
    data = text.encode("utf-8", "replace") if isinstance(text, str) else text
    return data[:_MAX_XMP_BYTES] if isinstance(data, bytes) else b""


def _is_named_so(name: str) -> bool:
    return Path(name).name.lower().startswith(_SCREENSHOT_NAMES)


def _is_twice_as_wide(gray: Float32) -> bool:
    height, width = gray.shape
    return abs(width - 2 * height) <= max(2, 0.01 * height)


def _wraps_around(gray: Float32) -> bool:
    """Return whether a picture of 2:1 joins at its sides and has one point of the world in its first and last rows."""
    left, right = _detail(gray[:, :2].mean(axis=1)), _detail(gray[:, -2:].mean(axis=1))
    if min(left.std(), right.std()) < _MIN_EDGE_TEXTURE:
        return False
    wraps = float(np.corrcoef(left, right)[0, 1])
    neighbours = (np.abs(gray[:, 0] - gray[:, 1]).mean() + np.abs(gray[:, -1] - gray[:, -2]).mean()) / 2
    jump = float(np.abs(gray[:, 0] - gray[:, -1]).mean() / max(float(neighbours), 0.5))
    poles = min(float(gray[0].std()), float(gray[-1].std()))
    usual = max(float(np.median(gray.std(axis=1))), 1.0)
    return wraps > _MIN_WRAP and jump < _MAX_JUMP and poles < _MAX_POLE * usual


def _detail(values: Float32) -> Float32:
    """Return the changes along a column that are shorter than about a tenth of it."""
    size = max(3, len(values) // 10) | 1
    padded = np.pad(values, size // 2, mode="edge")
    smooth = np.convolve(padded, np.full(size, 1.0 / size), mode="valid")
    return (values - smooth).astype(np.float32)


def _outermost(lit: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the outermost lit points [N, 2] on rays from the centre, of the rays on which they lie inside."""
    height, width = lit.shape
    x, y = (width - 1) / 2, (height - 1) / 2
    steps = np.arange(0.0, math.hypot(x, y), 0.5)
    points = []
    for angle in np.arange(_N_RAYS) * (2 * math.pi / _N_RAYS):
        columns, rows = x + steps * math.cos(angle), y + steps * math.sin(angle)
        inside = (columns >= 0) & (columns <= width - 1) & (rows >= 0) & (rows <= height - 1)
        values = lit[np.rint(rows[inside]).astype(int), np.rint(columns[inside]).astype(int)]
        found = np.flatnonzero(values)
        # At the border of the picture the circle is cut.
        if len(found) and found[-1] < len(values) - 4:
            points.append((columns[found[-1]], rows[found[-1]]))
    return np.array(points, np.float64).reshape(-1, 2)


def _fitted(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return centre and radius of the circle through points, by linear least squares."""
    system = np.column_stack([2 * points, np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    return float(x), float(y), math.sqrt(max(float(rest + x * x + y * y), 0.0))
