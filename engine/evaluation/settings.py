"""Settings of the evaluation of objects, and the ways of isolating that it compares."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..objects.settings import BETTER, PRESETS, SegmentSettings
from ..settings import require

__all__ = ["EvaluationSettings", "SeedKind", "Way", "ways_of"]

SeedKind = Literal["text", "mask", "click"]


@dataclass(frozen=True)
class EvaluationSettings:
    """What is isolated, how, and where it is looked at.

    Attributes
    ----------
    presets : tuple of str
        Of `engine.objects.settings.PRESETS`.
    seed : {"text", "mask", "click"}
        What every object is asked for with: its text; or, in the photo outside of the evaluated ones that shows it
        largest, its true mask or a click in the middle of that.
    views : {"held-out", "all"}
        Photos with true masks that are compared: those that training did not see, or all but the seed's.
    ablations : bool
        Also ``better`` with one ingredient switched off at a time.
    objects : tuple of str
        Only these prompts; all by default.
    """

    presets: tuple[str, ...] = ("paper", "better")
    seed: SeedKind = "mask"
    views: Literal["held-out", "all"] = "held-out"
    ablations: bool = False
    objects: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require(self, "presets", len(self.presets) > 0, "at least one preset")
        known = all(name in PRESETS for name in self.presets)
        require(self, "presets", known, f"of {', '.join(PRESETS)}")
        require(self, "presets", len(set(self.presets)) == len(self.presets), "different from each other")
        require(self, "presets", not self.ablations or "better" in self.presets, "with better among them for ablations")
        require(self, "seed", self.seed in ("text", "mask", "click"), "'text', 'mask' or 'click'")
        require(self, "views", self.views in ("held-out", "all"), "'held-out' or 'all'")


@dataclass(frozen=True)
class Way:
    """One way of isolating; a row of the table.

    Attributes
    ----------
    name : str
    settings : SegmentSettings
    snaps : bool
        Whether votes may snap to SAM's segments.
    """

    name: str
    settings: SegmentSettings
    snaps: bool = True


def ways_of(settings: EvaluationSettings) -> list[Way]:
    """Return the presets and then the ablations that are asked for.

    Snapping can only be left out where segments are not what a text is looked for in.
    """
    ways = [Way(name, PRESETS[name]) for name in settings.presets]
    if settings.ablations:
        ways += [
            Way("better, one part", replace(BETTER, parts=1)),
            Way("better, no votes", replace(BETTER, refinement="none")),
            Way("better, one vote round", replace(BETTER, vote_rounds=1)),
            Way("better, nothing filled in", replace(BETTER, completion="none")),
            Way("better, hull filled in", replace(BETTER, completion="hull")),
        ]
        if settings.seed == "mask":
            ways.append(Way("better, given mask only by its features", replace(BETTER, keep_given=False)))
        if settings.seed != "text":
            ways.append(Way("better, no snapping to segments", BETTER, snaps=False))
    return ways
