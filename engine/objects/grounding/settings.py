"""Settings of the grounding package."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.settings import require


@dataclass(frozen=True)
class GroundingSettings:
    """Criteria for keeping boxes of Grounding DINO.

    The defaults are between those of the paper "Gaussian Heritage" and of the model's demo. They were not measured.

    Attributes
    ----------
    box_threshold : float
        Boxes whose best token has a lower score are discarded.
    text_threshold : float
        Tokens of the prompt with a higher score form the label of a box.
    max_overlap : float
        Of two boxes whose IoU is higher than this value, the one with the lower score is discarded; 1 keeps all boxes.
    min_fit : float
        If segments are given, boxes whose best segment has a smaller fit (0 to 1) are discarded; see `best_segments`.
    """

    box_threshold: float = 0.3  # Dahaghin et al. 2024
    text_threshold: float = 0.25  # Liu et al. 2023
    max_overlap: float = 0.7  # chosen on museum_room
    min_fit: float = 0.2  # chosen on museum_room

    def __post_init__(self) -> None:
        require(self, "box_threshold", 0 < self.box_threshold < 1, "between 0 and 1")
        require(self, "text_threshold", 0 < self.text_threshold < 1, "between 0 and 1")
        require(self, "max_overlap", 0 < self.max_overlap <= 1, "above 0, at most 1")
        require(self, "min_fit", 0 <= self.min_fit < 1, "at least 0, below 1")
