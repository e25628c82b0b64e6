"""Settings of the evaluation of objects, and the segmentation methods that it compares."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ..objects.settings import BETTER, PRESETS, SegmentSettings
from ..settings import require

__all__ = ["EvaluationSettings", "PromptKind", "Method", "methods_of"]

PromptKind = Literal["text", "mask", "click"]


@dataclass(frozen=True)
class EvaluationSettings:
    """Objects, methods and photos of an evaluation.

    Attributes
    ----------
    presets : tuple of str
        Names in `engine.objects.settings.PRESETS`.
    prompt_kind : {"text", "mask", "click"}
        Prompt for every object: its text; or its true mask, or a click in the middle of that mask, in the photo that
        shows it largest among those not evaluated.
    views : {"held-out", "all"}
        Photos with true masks that are compared: those that training did not see, or all except that of the prompt.
    ablations : bool
        Also compare ``better`` with one ingredient switched off at a time.
    view_counts : tuple of int
        Also compare every preset with these numbers of photos, where it uses them: photos that vote, and photos that
        are searched for a text.
    objects : tuple of str
        Objects to evaluate; all by default.
    """

    presets: tuple[str, ...] = ("paper", "better")
    prompt_kind: PromptKind = "mask"
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
        require(self, "prompt_kind", self.prompt_kind in ("text", "mask", "click"), "'text', 'mask' or 'click'")
        require(self, "views", self.views in ("held-out", "all"), "'held-out' or 'all'")


@dataclass(frozen=True)
class Method:
    """One segmentation method; a row of the table.

    Attributes
    ----------
    name : str
    settings : SegmentSettings
    snaps : bool
        Whether votes may snap to SAM's segments.
    preset : str
        Preset whose number of views the method varies, or the preset itself; empty for ablations.
    n_views : int
        Number of views; 0 without `preset`.
    """

    name: str
    settings: SegmentSettings
    snaps: bool = True
    preset: str = ""
    n_views: int = 0


def methods_of(settings: EvaluationSettings) -> list[Method]:
    """Return the presets, the ablations and the variants with other numbers of views, in this order.

    Snapping is not an ablation for texts, since a text is searched for in the same segments.
    """
    counts = {name: _n_views(PRESETS[name], settings.prompt_kind) for name in settings.presets}
    methods = [Method(name, PRESETS[name], preset=name, n_views=counts[name]) for name in settings.presets]
    if settings.ablations:
        methods += [
            Method("better, one part", replace(BETTER, parts=1)),
            Method("better, no votes", replace(BETTER, refinement="none")),
            Method("better, one vote round", replace(BETTER, vote_rounds=1)),
            Method("better, hull filled in", replace(BETTER, completion="hull")),
        ]
        if settings.prompt_kind == "mask":
            methods.append(Method("better, given mask only by its features", replace(BETTER, keep_given=False)))
        if settings.prompt_kind != "text":
            methods.append(Method("better, no snapping to segments", BETTER, snaps=False))
    for name in settings.presets:
        for count in settings.view_counts:
            if counts[name] not in (0, count):
                fewer = replace(PRESETS[name], n_text_views=count, n_vote_views=count)
                methods.append(
                    Method(f"{name}, {count} {'view' if count == 1 else 'views'}", fewer, preset=name, n_views=count)
                )
    return methods


def _n_views(settings: SegmentSettings, prompt_kind: PromptKind) -> int:
    """Return the largest number of photos that a preset uses; 0 where it uses that of the prompt only."""
    return max(
        settings.n_text_views if prompt_kind == "text" else 0,
        settings.n_vote_views if settings.refinement == "votes" else 0,
    )
