"""Settings of a comparison of presets. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.settings import require
from ...rasterizer.settings import DeviceName
from ...training.settings import PRESETS

EVERYTHING = "_full"
"""Ending of the name of a preset that is trained with nothing left out."""


@dataclass(frozen=True)
class BenchSettings:
    """One comparison.

    Attributes
    ----------
    presets : tuple of str
        Names of the presets in the order in which they are trained.
    wants_objects : bool
        Whether masks are made and features trained.
    everything : bool
        Train each preset once more with nothing left out: every step, masks of all photos, features, and brightness
        correction. The difference is what leaving out saves and costs.
    random_seeds : tuple of int
        Each preset is trained once with each of them. Differences between presets that are smaller than those between
        seeds are chance.
    limit_minutes : float or None
        Wall time after which the training of a preset is stopped; its row says so.
    device : {"auto", "cpu", "gpu"}
        What is trained on, see ``reconstruct --device``.
    given_cameras, photo_masks : Path or None
        As for the command ``reconstruct``.
    """

    presets: tuple[str, ...] = ("preview", "standard")
    wants_objects: bool = True
    everything: bool = False
    random_seeds: tuple[int, ...] = (0,)
    limit_minutes: float | None = None
    device: DeviceName = "auto"
    given_cameras: Path | None = None
    photo_masks: Path | None = None

    def __post_init__(self) -> None:
        require(self, "presets", len(self.presets) > 0, "at least one preset")
        known = all(name in PRESETS for name in self.presets)
        require(self, "presets", known, f"of {', '.join(PRESETS)}")
        require(self, "presets", len(set(self.presets)) == len(self.presets), "different from each other")
        require(self, "random_seeds", len(self.random_seeds) > 0, "at least one number")
        require(
            self, "random_seeds", len(set(self.random_seeds)) == len(self.random_seeds), "different from each other"
        )
        require(self, "random_seeds", all(seed >= 0 for seed in self.random_seeds), "at least 0")
        require(self, "limit_minutes", self.limit_minutes is None or self.limit_minutes > 0, "greater than 0")
