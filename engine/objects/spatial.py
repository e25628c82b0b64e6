"""Spatial words of a text: "the left vase", "largest pot", "bowl on the table", "bell next to the clock".

Left and right are those of a camera. Sizes, and what is on, in or next to something, are those of the scene, in which Z
is up: a picture shows near things larger.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Floats
from ..core.errors import PromptError
from ..scene import Camera, PinholeCamera

_SELECTORS = {
    "left": "left|leftmost|left-hand",
    "right": "right|rightmost|right-hand",
    "largest": "largest|biggest",
    "smallest": "smallest",
}
_RELATIONS = {
    "left": "(?:to the )?left of",
    "right": "(?:to the )?right of",
    "on": "on top of|on|upon",
    "in": "inside of|inside|in|within",
    "next to": "next to|beside|near",
}
_ARTICLE = r"(?:(?:a|an|the)\s+)?"
_PATTERNS = (
    *((word, rf"{_ARTICLE}(?:{forms})\s+(?P<noun>.+)") for word, forms in _SELECTORS.items()),
    *((word, rf"(?P<noun>.+?)\s+(?:on|at|to) the (?:{forms})") for word, forms in _SELECTORS.items()),
    *((word, rf"(?P<noun>.+?)\s+(?:{forms})\s+{_ARTICLE}(?P<other>.+)") for word, forms in _RELATIONS.items()),
)


@dataclass(frozen=True)
class SpatialText:
    """A text taken apart.

    Attributes
    ----------
    noun : str
    word : str
        ``left``, ``right``, ``largest``, ``smallest``, ``on``, ``in``, ``next to`` or empty.
    other : str
        What the word relates the noun to; empty for "the left vase".
    """

    noun: str
    word: str = ""
    other: str = ""


@dataclass(frozen=True)
class Extent:
    """`inner_box` of a set of Gaussians.

    Attributes
    ----------
    low, center, high : array of shape [3], float
        World units.
    """

    low: Floats
    center: Floats
    high: Floats

    @property
    def size(self) -> float:
        """Length of the diagonal, world units."""
        return float(np.linalg.norm(self.high - self.low))

    def gap(self, other: Extent) -> float:
        """Return the distance between the boxes of the two, world units; 0 where they touch."""
        return float(np.linalg.norm(np.maximum(0, np.maximum(self.low - other.high, other.low - self.high))))

    def holds(self, point: Floats, axes: slice = slice(None)) -> bool:
        """Return whether a point, [3], is inside of the box along some axes."""
        return bool(((point >= self.low) & (point <= self.high))[axes].all())


def parse_spatial(text: str) -> SpatialText:
    """Return the noun, the spatial word and the other noun of a text; only the noun where it has no spatial word."""
    plain = " ".join(text.lower().split())
    for word, pattern in _PATTERNS:
        if match := re.fullmatch(pattern, plain):
            return SpatialText(match["noun"], word, match.groupdict().get("other", ""))
    return SpatialText(text.strip())


def showing_camera(cameras: Sequence[Camera], extents: Sequence[Extent]) -> Camera:
    """Return the camera that shows most of the extents, the nearest of several.

    Raises
    ------
    PromptError
        Without cameras.
    """
    from ..cameras import is_point_visible

    if not cameras:
        raise PromptError("The scene has no photo, so there is no left or right. Name the object without them.")

    def value(camera: Camera) -> tuple[int, float]:
        distance = sum(float(np.linalg.norm(camera.center - extent.center)) for extent in extents)
        return sum(is_point_visible(camera, extent.center) for extent in extents), -distance

    return max(cameras, key=value)


def choose(
    spatial: SpatialText, found: Sequence[Extent], others: Sequence[Extent], camera: Camera | PinholeCamera | None
) -> list[int]:
    """Return the numbers of the extents that the spatial word means, at least one.

    Parameters
    ----------
    found : sequence of Extent
        What the noun names, at least one.
    others : sequence of Extent
        What the other noun names.
    camera : Camera, PinholeCamera or None
        From which left and right are seen.

    Returns
    -------
    list of int
        Indices of `found`.

    Raises
    ------
    PromptError
        When nothing is there, or left and right have no camera.
    """
    word, other_noun = spatial.word, spatial.other
    if word in ("left", "right") and camera is None:
        raise PromptError(f"{word!r} needs a photo or a view to look from. Give one, or use another word.")
    if not other_noun:
        values = [_column(camera, one) if word in ("left", "right") else one.size for one in found]
        return [int(np.argmax(values) if word in ("right", "largest") else np.argmin(values))]
    pairs = [(k, one, other) for k, one in enumerate(found) for other in others if (one.center != other.center).any()]
    if word == "next to":
        near = [(one.gap(other), k) for k, one, other in pairs if one.gap(other) <= one.size + other.size]
        chosen = [number for _, number in sorted(near)[:1]]
    else:
        chosen = sorted({k for k, one, other in pairs if _holds(word, one, other, camera)})
    if not chosen:
        what = f"no {spatial.noun!r} {word}{' of' if word in ('left', 'right') else ''} {other_noun!r}"
        reason = "" if others else f", because no {other_noun!r} was found"
        raise PromptError(f"There is {what}{reason}. Ask for {spatial.noun!r} alone, or click on the object instead.")
    return chosen


def _holds(word: str, one: Extent, other: Extent, camera: Camera | PinholeCamera | None) -> bool:
    if word == "in":
        return other.holds(one.center)
    if word == "on":
        nearer_to_top = abs(one.low[2] - other.high[2]) < abs(one.low[2] - other.low[2])
        return other.holds(one.center, slice(2)) and bool(nearer_to_top and one.center[2] > other.center[2])
    return (_column(camera, one) < _column(camera, other)) == (word == "left")


def _column(camera: Camera | PinholeCamera | None, extent: Extent) -> float:
    """Return how far right of the middle a camera sees the centre of an extent, as an angle."""
    assert camera is not None
    x, _, z = camera.viewmat[:3, :3] @ extent.center + camera.viewmat[:3, 3]
    return float(np.arctan2(x, z))
