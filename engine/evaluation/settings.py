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
    view_counts : tuple of int
        Also every preset with so many photos looked at, where that makes a difference to it: those that vote, and for
        a text those that are searched.
    objects : tuple of str
        Only these; all by default.
    """

    presets: tuple[str, ...] = ("paper", "better")
    seed: SeedKind = "mask"
    views: Literal["held-out", "all"] = "held-out"
    ablations: bool = False
    view_counts: tuple[int, ...] = ()
    objects: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require(self, "presets", len(self.presets) > 0, "at least one preset")
        known = all(name in PRESETS for name in self.presets)
        require(self, "presets", known, f"of {', '.join(PRESETS)}")
        require(self, "presets", len(set(self.presets)) == len(self.presets), "different from each other")
        require(self, "presets", not self.ablations or "better" in self.presets, "with better among them for ablations")
        require(self, "view_counts", all(count >= 1 for count in self.view_counts), "at least 1 each")
        different = len(set(self.view_counts)) == len(self.view_counts)
        require(self, "view_counts", different, "different from each other")
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
    preset : str
        Whose number of views is varied, where the way is one of those or the preset itself; else empty.
    n_views : int
        That number; 0 without `preset`.
    """

    name: str
    settings: SegmentSettings
    snaps: bool = True
    preset: str = ""
    n_views: int = 0


def ways_of(settings: EvaluationSettings) -> list[Way]:
    """Return the presets, then the ablations and then the numbers of views that are asked for.

    Snapping can only be left out where segments are not what a text is looked for in.
    """
    counts = {name: _n_views(PRESETS[name], settings.seed) for name in settings.presets}
    ways = [Way(name, PRESETS[name], preset=name, n_views=counts[name]) for name in settings.presets]
    if settings.ablations:
        ways += [
            Way("better, one part", replace(BETTER, parts=1)),
            Way("better, no votes", replace(BETTER, refinement="none")),
            Way("better, one vote round", replace(BETTER, vote_rounds=1)),
            Way("better, hull filled in", replace(BETTER, completion="hull")),
        ]
        if settings.seed == "mask":
            ways.append(Way("better, given mask only by its features", replace(BETTER, keep_given=False)))
        if settings.seed != "text":
            ways.append(Way("better, no snapping to segments", BETTER, snaps=False))
    for name in settings.presets:
        for count in settings.view_counts:
            if counts[name] not in (0, count):
                fewer = replace(PRESETS[name], n_text_views=count, n_vote_views=count)
                ways.append(
                    Way(f"{name}, {count} {'view' if count == 1 else 'views'}", fewer, preset=name, n_views=count)
                )
    return ways


def _n_views(settings: SegmentSettings, seed: SeedKind) -> int:
    """Return how many photos are looked at, at most; 0 where only the one that the person gave."""
    return max(
        settings.n_text_views if seed == "text" else 0,
        settings.n_vote_views if settings.refinement == "votes" else 0,
    )
