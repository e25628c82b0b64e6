"""Settings of the evaluation of objects, and the segmentation methods that it compares."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ...core.settings import require, require_choices
from ...objects.settings import BETTER, PRESETS, PaperSettings, SegmentSettings

PromptKind = Literal["text", "mask", "click", "all"]
Views = Literal["held-out", "all"]
Layout = Literal["museum", "lerf-mask", "3d-ovs", "lerf-ovs"]
"""Layouts of folders with a ground truth."""

IN_SAMPLE_SCENES = ("museum_room", "store_room", *(f"room_{number}" for number in range(1, 9)))
"""Scenes that constants of the method were chosen on. On any other scene an evaluation is a test."""

IN_SAMPLE_PHOTO_SETS = ("banana16", "sakharov_statue32", "skull66")
"""Real photo sets that constants of training were chosen on."""

MARKS = {
    "in sample": "**In sample**: constants of the method were chosen on this scene.",
    "test": "**Test**: no constant of the method was chosen on this scene.",
}
"""Sentence above a table that says whether its figures are in sample or a test, see docs/constants.md."""

_FINDS_ALL = "better"
"""Preset that can find all objects without a prompt. The other presets follow the paper, which has no such method."""


@dataclass(frozen=True)
class EvaluationSettings:
    """Objects, methods and photos of an evaluation.

    Attributes
    ----------
    presets : tuple of str
        Names in `engine.objects.settings.PRESETS`.
    prompt_kind : {"text", "mask", "click", "all"}
        Prompt for every object: its text; or its true mask, or a click in the middle of that mask, in the photo that
        shows it largest among those not evaluated. ``text`` also asks for things that the scene does not show, unless
        `objects` is given. ``all`` searches for all objects without a prompt, with the presets that can do so.
    views : {"held-out", "all"}
        Photos with true masks that are compared: those that training did not see, or all except that of the prompt.
        With ``held-out`` isolating an object looks at no photo that is compared for it, with ``all`` at every photo.
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
    views: Views = "held-out"
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
        require_choices(self)
        finds_all = self.prompt_kind != "all" or _FINDS_ALL in self.presets
        require(self, "presets", finds_all, f"with {_FINDS_ALL} among them to find all objects")


@dataclass(frozen=True)
class Method:
    """One segmentation method; a row of the table.

    Attributes
    ----------
    name : str
    settings : SegmentSettings
    without : {"", "segments", "neighbours", "features"}
        Links of the graph of the scene that are left out: those to the segments of the photos, those between Gaussians,
        or the features in the weights of the latter.
    preset : str
        Preset whose number of views the method varies, or the preset itself; empty for ablations.
    n_views : int
        Number of views; 0 without `preset`.
    """

    name: str
    settings: SegmentSettings
    without: Literal["", "segments", "neighbours", "features"] = ""
    preset: str = ""
    n_views: int = 0


def methods_of(settings: EvaluationSettings) -> list[Method]:
    """Return the presets, the ablations and the variants with other numbers of views, in this order.

    Texts and searches for all objects have no ablations.
    """
    presets = tuple(name for name in settings.presets if settings.prompt_kind != "all" or name == _FINDS_ALL)
    counts = {name: _n_views(PRESETS[name], settings.prompt_kind) for name in presets}
    methods = [Method(name, PRESETS[name], preset=name, n_views=counts[name]) for name in presets]
    if settings.ablations and settings.prompt_kind in ("mask", "click"):
        methods += [
            Method("better, no links to segments", BETTER, without="segments"),
            Method("better, no links between Gaussians", BETTER, without="neighbours"),
            Method("better, links without features", BETTER, without="features"),
            Method("better, strictness 1", replace(BETTER, strictness=1.0)),
        ]
    for name in presets:
        for count in settings.view_counts:
            if counts[name] not in (0, count):
                fewer = replace(PRESETS[name], n_text_views=count, n_vote_views=count)
                methods.append(
                    Method(f"{name}, {count} {'view' if count == 1 else 'views'}", fewer, preset=name, n_views=count)
                )
    return methods


def _n_views(settings: SegmentSettings, prompt_kind: PromptKind) -> int:
    """Return the largest number of photos that a preset uses; 0 where its settings do not say it."""
    if prompt_kind == "all":
        return 0
    return max(
        settings.n_text_views if prompt_kind == "text" else 0,
        0 if isinstance(settings, PaperSettings) else settings.n_vote_views,
    )
