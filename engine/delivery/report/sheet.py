"""Pictures of objects alone on a plain background, and one sheet of all objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ...core.arrays import Pixels
from ...core.visible_text import visible
from ...pictures import Scene
from ...scene import PinholeCamera

PAPER_WHITE = (0.965, 0.957, 0.937)
"""Background of objects, sRGB in [0, 1]: the colour of the page."""
_MIN_ALPHA, _FULL_ALPHA = 0.3, 0.7
"""Alpha that becomes background, and alpha that becomes opaque: Gaussians fade out over more pixels than an outline."""
_SPECK_MARGIN = 2
"""Pixels by which the kept areas grow, so that their soft edge is kept too."""
_GAP = 8
"""Space between pictures, pixels."""
_CAPTION_HEIGHT = 34
"""Height of a caption, pixels."""
_MAX_CAPTION = 200
"""Characters; more do not fit the width of the picture."""
_CAPTION_COLOR = (60, 56, 50)
"""Colour of captions, sRGB, 0 to 255."""


def render_alone(scene: Scene, camera: PinholeCamera) -> Pixels:
    """Return a picture of Gaussians on the colour of paper with a clean edge, uint8 [H, W, 3].

    Parameters
    ----------
    scene : Scene
        The Gaussians of the object alone, for all of its pictures.

    Notes
    -----
    Alpha below 0.3 becomes background, alpha above 0.7 opaque. Connected areas smaller than a hundredth of the largest
    one are removed.
    """
    rendered = scene.render(camera, color=True)
    alpha = rendered.alpha
    step = np.clip((alpha - _MIN_ALPHA) / (_FULL_ALPHA - _MIN_ALPHA), 0, 1)
    edge = step * step * (3 - 2 * step)
    count, areas, stats, _ = cv2.connectedComponentsWithStats((alpha > 0.5).astype(np.uint8))
    if count > 1:
        sizes = stats[1:, cv2.CC_STAT_AREA]
        kept = np.isin(areas, 1 + np.flatnonzero(sizes >= 0.01 * sizes.max()))
        side = 2 * _SPECK_MARGIN + 1
        edge = edge * (cv2.dilate(kept.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
    color = rendered.channels / np.maximum(alpha, 1e-3)[..., None]
    blended = edge[..., None] * np.clip(color, 0, 1) + (1 - edge[..., None]) * np.array(PAPER_WHITE, np.float32)
    return np.rint(np.clip(blended, 0, 1) * 255).astype(np.uint8)


def picture_sheet(rows: Sequence[tuple[str, Sequence[Pixels]]]) -> Pixels | None:
    """Return one picture with a row for each object: its name, and its pictures below.

    Parameters
    ----------
    rows : sequence of (str, sequence of uint8 arrays [h, w, 3])
        Name and pictures of each object, all of one size; objects without pictures are left out.

    Returns
    -------
    array of shape [H, W, 3], uint8, or None when there are no pictures
    """
    import matplotlib
    from PIL import Image, ImageDraw, ImageFont

    shown = [(name, list(sides)) for name, sides in rows if len(sides)]
    if not shown:
        return None
    height, width = shown[0][1][0].shape[:2]
    columns = max(len(sides) for _, sides in shown)
    paper = tuple(int(round(255 * value)) for value in PAPER_WHITE)
    size = (columns * (width + _GAP) + _GAP, len(shown) * (height + _CAPTION_HEIGHT + _GAP) + _GAP)
    sheet = Image.new("RGB", size, paper)
    # Matplotlib brings this font, which has the letters of all European scripts; that of Pillow has ASCII alone.
    file = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    draw, font = ImageDraw.Draw(sheet), ImageFont.truetype(str(file), 20)
    for number, (name, sides) in enumerate(shown):
        top = _GAP + number * (height + _CAPTION_HEIGHT + _GAP)
        draw.text((_GAP, top), visible(name[:_MAX_CAPTION]), _CAPTION_COLOR, font)
        for column, side in enumerate(sides):
            sheet.paste(Image.fromarray(side), (_GAP + column * (width + _GAP), top + _CAPTION_HEIGHT))
    return np.asarray(sheet)
