"""Objects alone, clean-edged on a neutral ground, and all of them on one sheet from four sides each."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..pictures import Backend, Scene
from ..scene import Gaussians, PinholeCamera

__all__ = ["alone", "picture_sheet"]

Pixels = NDArray[np.uint8]

_FAINT, _SOLID = 0.3, 0.7
"""Coverage that becomes ground and object: between them Gaussians fade out, wider than a silhouette in a photo does."""

_REACH = 2
_GAP = 8
_CAPTION = 34
_INK = (60, 56, 50)


def alone(gaussians: Gaussians, camera: PinholeCamera, ground: Sequence[float], *, backend: Backend = "cpu") -> Pixels:
    """Return Gaussians before a plain ground with a clean edge, uint8 [H, W, 3].

    Parameters
    ----------
    gaussians : Gaussians
        The object's.
    camera : PinholeCamera
    ground : sequence of 3 floats
        sRGB in [0, 1].
    backend : {"cpu", "reference"}

    Notes
    -----
    What covers less than three tenths of a pixel is left out, what covers seven tenths is opaque. Specks that hang
    together with nothing large are left out too.
    """
    rendered = Scene(gaussians, backend=backend).render(camera, color=True)
    alpha = rendered.alpha
    step = np.clip((alpha - _FAINT) / (_SOLID - _FAINT), 0, 1)
    edge = step * step * (3 - 2 * step)
    count, areas, stats, _ = cv2.connectedComponentsWithStats((alpha > 0.5).astype(np.uint8))
    if count > 1:
        sizes = stats[1:, cv2.CC_STAT_AREA]
        kept = np.isin(areas, 1 + np.flatnonzero(sizes >= 0.01 * sizes.max()))
        side = 2 * _REACH + 1
        edge = edge * (cv2.dilate(kept.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
    color = rendered.channels / np.maximum(alpha, 1e-3)[..., None]
    blended = edge[..., None] * np.clip(color, 0, 1) + (1 - edge[..., None]) * np.asarray(ground, np.float32)
    return np.rint(np.clip(blended, 0, 1) * 255).astype(np.uint8)


def picture_sheet(rows: Sequence[tuple[str, Sequence[Pixels]]], ground: Sequence[float]) -> Pixels | None:
    """Return one picture with a row for each object: its name, and under it its sides.

    Parameters
    ----------
    rows : sequence of (str, sequence of uint8 arrays [h, w, 3])
        All pictures of one size; objects without any are left out.
    ground : sequence of 3 floats
        sRGB in [0, 1].

    Returns
    -------
    array of shape [H, W, 3], uint8, or None when there is nothing to show
    """
    from PIL import Image, ImageDraw, ImageFont

    shown = [(name, list(sides)) for name, sides in rows if len(sides)]
    if not shown:
        return None
    height, width = shown[0][1][0].shape[:2]
    columns = max(len(sides) for _, sides in shown)
    paper = tuple(int(round(255 * value)) for value in ground)
    size = (columns * (width + _GAP) + _GAP, len(shown) * (height + _CAPTION + _GAP) + _GAP)
    sheet = Image.new("RGB", size, paper)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(20)
    for number, (name, sides) in enumerate(shown):
        top = _GAP + number * (height + _CAPTION + _GAP)
        # The built-in font has no letters beyond Latin: what it lacks would be drawn as boxes.
        draw.text((_GAP, top), name if name.isascii() else name.encode("ascii", "replace").decode(), _INK, font)
        for column, side in enumerate(sides):
            sheet.paste(Image.fromarray(side), (_GAP + column * (width + _GAP), top + _CAPTION))
    return np.asarray(sheet)
