"""How presets are compared. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..settings import require
from ..training.settings import PRESETS

__all__ = ["EVERYTHING", "BenchSettings"]

EVERYTHING = "_full"
"""Ending of the name of a preset whose leaving-out is switched off."""


@dataclass(frozen=True)
class BenchSettings:
    """One comparison.

    Attributes
    ----------
    presets : tuple of str
        In the order in which they are trained.
    wants_objects : bool
        Without, no masks are made and no features trained.
    everything : bool
        Train each preset once more with leaving-out switched off: every step, masks of all photos, features, and
        brightness correction. What leaving out saves and costs is the difference, measured.
    seeds : tuple of int
        Each preset is trained by each of them: what differs by less than they do, differs by chance.
    limit_minutes : float or None
        Training of a preset is stopped after this much wall time; its row says so.
    camera_model, photo_masks : Path or None
        As for `reconstruct`.
    """

    presets: tuple[str, ...] = ("preview", "standard")
    wants_objects: bool = True
    everything: bool = False
    seeds: tuple[int, ...] = (0,)
    limit_minutes: float | None = None
    camera_model: Path | None = None
    photo_masks: Path | None = None

    def __post_init__(self) -> None:
        require(self, "presets", len(self.presets) > 0, "at least one preset")
        known = all(name in PRESETS for name in self.presets)
        require(self, "presets", known, f"of {', '.join(PRESETS)}")
        require(self, "presets", len(set(self.presets)) == len(self.presets), "different from each other")
        require(self, "seeds", len(self.seeds) > 0, "at least one number")
        require(self, "seeds", len(set(self.seeds)) == len(self.seeds), "different from each other")
        require(self, "seeds", all(seed >= 0 for seed in self.seeds), "at least 0")
        require(self, "limit_minutes", self.limit_minutes is None or self.limit_minutes > 0, "greater than 0")
