"""Settings of the grounding room."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import require

__all__ = ["GroundingSettings"]


@dataclass(frozen=True)
class GroundingSettings:
    """Which of Grounding DINO's answers are kept.

    The defaults lie between those of the paper "Gaussian Heritage" and of the model's own demo; none was measured here.

    Attributes
    ----------
    box_threshold : float
        Boxes whose best token scores lower are dropped.
    text_threshold : float
        Tokens of the prompt that score higher make a box's label.
    max_overlap : float
        Of two boxes with a higher IoU than this the one with the lower score is dropped; 1 keeps all.
    min_fit : float
        Where segments are given: a box is dropped when no segment fits it better than this, 0 to 1.
    """

    box_threshold: float = 0.3
    text_threshold: float = 0.25
    max_overlap: float = 0.7
    min_fit: float = 0.2

    def __post_init__(self) -> None:
        require(self, "box_threshold", 0 < self.box_threshold < 1, "between 0 and 1")
        require(self, "text_threshold", 0 < self.text_threshold < 1, "between 0 and 1")
        require(self, "max_overlap", 0 < self.max_overlap <= 1, "above 0, at most 1")
        require(self, "min_fit", 0 <= self.min_fit < 1, "at least 0, below 1")
