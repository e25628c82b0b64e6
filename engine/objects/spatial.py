"""Spatial words of a text: "the left vase", "largest pot", "bowl on the table", "bell next to the clock".

Left and right are those of a camera. Sizes, and what is on, in or next to something, are those of the scene, in which Z
is up: a picture shows near things larger.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..scene import Camera, PinholeCamera

__all__ = ["Extent", "SpatialText", "choose", "parse_spatial", "showing_camera"]

_SELECTORS = {
    "left": r"left|leftmost|left-hand",
    "right": r"right|rightmost|right-hand",
    "largest": r"largest|biggest",
    "smallest": r"smallest",
}
_RELATIONS = {
    "left": r"(?:to the )?left of",
    "right": r"(?:to the )?right of",
    "on": r"on top of|on|upon",
    "in": r"inside of|inside|in|within",
    "next to": r"next to|beside|near",
}
_ARTICLE = r"(?:(?:a|an|the)\s+)?"
_BEFORE = {word: re.compile(rf"^{_ARTICLE}(?:{forms})\s+(?P<noun>.+)$") for word, forms in _SELECTORS.items()}
_AFTER = {word: re.compile(rf"^(?P<noun>.+?)\s+(?:on|at|to) the (?:{forms})$") for word, forms in _SELECTORS.items()}
_BETWEEN = {
    word: re.compile(rf"^(?P<noun>.+?)\s+(?:{forms})\s+{_ARTICLE}(?P<other>.+)$") for word, forms in _RELATIONS.items()
}


@dataclass(frozen=True)
class SpatialText:
    """A text taken apart.

    Attributes
    ----------
    noun : str
        What is asked for.
    word : str
        ``left``, ``right``, ``largest``, ``smallest``, ``on``, ``in`` or ``next to``; empty without a spatial word.
    other : str
        What `word` relates the noun to; empty for "the left vase" and the like.
    """

    noun: str
    word: str = ""
    other: str = ""


@dataclass(frozen=True)
class Extent:
    """Place and size of a set of Gaussians in world units, without the outermost twentieth on each side.

    Attributes
    ----------
    low, high, center : arrays of shape [3]
    """

    low: NDArray[np.floating]
    high: NDArray[np.floating]
    center: NDArray[np.floating]

    @classmethod
    def of(cls, means: NDArray[np.floating]) -> Extent:
        """Return the extent of Gaussians at `means`, [n, 3], n > 0."""
        low, center, high = np.percentile(means, [5, 50, 95], axis=0)
        return cls(low, high, center)

    @property
    def size(self) -> float:
        """Length of the diagonal."""
        return float(np.linalg.norm(self.high - self.low))

    def gap(self, other: Extent) -> float:
        """Return the distance between the boxes of the two; 0 where they touch."""
        return float(np.linalg.norm(np.maximum(0, np.maximum(self.low - other.high, other.low - self.high))))

    def holds(self, point: NDArray[np.floating], axes: int = 3) -> bool:  # by definition
        """Return whether a point, [3], is inside of the box along the first `axes` axes."""
        return bool(((point >= self.low) & (point <= self.high))[:axes].all())


def parse_spatial(text: str) -> SpatialText:
    """Return the noun, the spatial word and the other noun of a text; only the noun where it has no spatial word."""
    plain = " ".join(text.lower().split())
    for word, pattern in (*_BEFORE.items(), *_AFTER.items(), *_BETWEEN.items()):
        match = pattern.match(plain)
        if match:
            return SpatialText(match["noun"], word, match.groupdict().get("other", ""))
    return SpatialText(text.strip())


def showing_camera(cameras: Sequence[Camera], extents: Sequence[Extent]) -> Camera:
    """Return the camera of the photo that shows most of the extents, and of those photos the nearest.

    Raises
    ------
    PromptError
        When there are no cameras.
    """
    from ..cameras import is_point_visible

    if not cameras:
        raise PromptError("The scene has no photo, so there is no left or right. Name the object without them.")

    def value(camera: Camera) -> tuple[int, float]:
        distance = sum(float(np.linalg.norm(camera.center - extent.center)) for extent in extents)
        return sum(is_point_visible(camera, extent.center) for extent in extents), -distance

    return max(cameras, key=value)


def choose(
    spatial: SpatialText,
    found: Sequence[Extent],
    others: Sequence[Extent],
    camera: Camera | PinholeCamera | None,
) -> list[int]:
    """Return the numbers of the extents in `found` that the spatial word means, at least one.

    Parameters
    ----------
    spatial : SpatialText
        With a word.
    found : sequence of Extent
        What the noun names; not empty.
    others : sequence of Extent
        What the other noun names.
    camera : Camera or PinholeCamera or None
        For ``left`` and ``right``: where the user looks from.

    Raises
    ------
    PromptError
        When nothing is there, or ``left`` or ``right`` has no camera.
    """
    if spatial.word in ("left", "right") and camera is None:
        raise PromptError(f"{spatial.word!r} needs a photo or a view to look from. Give one, or use another word.")
    if not spatial.other:
        value = {
            "left": lambda k: _column(camera, found[k]),
            "right": lambda k: -_column(camera, found[k]),
            "largest": lambda k: -found[k].size,
            "smallest": lambda k: found[k].size,
        }[spatial.word]
        return [min(range(len(found)), key=value)]
    pairs = [
        (k, other) for k in range(len(found)) for other in others if not np.array_equal(found[k].center, other.center)
    ]
    if spatial.word == "next to":
        near = [(found[k].gap(other), k) for k, other in pairs if found[k].gap(other) <= found[k].size + other.size]
        chosen = [min(near)[1]] if near else []
    else:
        chosen = sorted({k for k, other in pairs if _holds(spatial.word, found[k], other, camera)})
    if not chosen:
        relation = f"{spatial.word} of" if spatial.word in ("left", "right") else spatial.word
        what = f"no {spatial.noun!r} {relation} {spatial.other!r}"
        reason = "" if others else f", because no {spatial.other!r} was found"
        raise PromptError(f"There is {what}{reason}. Ask for {spatial.noun!r} alone, or click on the object instead.")
    return chosen


def _holds(word: str, one: Extent, other: Extent, camera: Camera | PinholeCamera | None) -> bool:
    if word == "in":
        return other.holds(one.center)
    if word == "on":
        nearer_to_top = abs(one.low[2] - other.high[2]) < abs(one.low[2] - other.low[2])
        return other.holds(one.center, axes=2) and bool(nearer_to_top and one.center[2] > other.center[2])
    return (_column(camera, one) < _column(camera, other)) == (word == "left")


def _column(camera: Camera | PinholeCamera | None, extent: Extent) -> float:
    """Return how far right of the middle a camera sees the centre of an extent: the tangent of the angle."""
    assert camera is not None
    x, _, z = camera.viewmat[:3, :3] @ extent.center + camera.viewmat[:3, 3]
    return float(np.arctan2(x, z))
