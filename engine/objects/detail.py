"""Detail: the Gaussians of an object are trained further on the photos that show it, at the photos' own resolution.

A scene is trained on reduced photos, and an object covers a small part of each. In the scene its front may also be
translucent, because what is behind it has the same colour, and a Gaussian may reach into a wall that hides it. Without
the scene, the first is a hole and the second a spike. The scene itself stays as it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Mask
from ..core.errors import Cancelled, EnvironmentProblem
from ..core.events import StopCheck
from ..pictures import Scene
from ..scene import Detailed, Gaussians
from ..training import DetailCrop, DetailPlan, tiles, train_detail
from .detail_cutter import DetailCutter, DetailPhotos
from .settings import SegmentSettings
from .views import Views, spread_cameras

_MAX_PHOTOS = 40
"""Photos of which crops are made, those that differ most: each takes memory, and the steps are the same for more."""

_MIN_PHOTOS = 3
"""Photos that an object needs: fewer say nothing of how deep a detail is."""

_VALIDATION_SHARE, _MAX_VALIDATION = 0.12, 4
"""Share of the training photos that decide whether the detail is kept, where no test photo shows the object, and the
largest number of photos that decide."""

_SHARPNESS_PIXELS = 20_000
"""Pixels of a reduced crop whose sharpness is compared with that of others."""

_JUDGED_PIXELS = 600_000
"""Pixels of a photo, in windows all over the object, that decide."""

_CLEARLY_LESS = 0.9
"""Coverage outside of the outline, relative to that before, below which it is less."""

_NOTHING_OUTSIDE = 0.005
"""Coverage outside of the outline, over the pixels inside, of which less is not seen."""

_MIN_GAIN = 0.02
"""Gain on these photos, in dB, below which the detail is not kept. What is not worse by more is kept as well if it
covers less outside of the outline."""

_LOSS_FOR_HALF = 0.15  # chosen on herz_jesus25, room_1, room_5, room_7
"""Loss on these photos, in dB, that is not seen beside half of the coverage outside; a quarter allows twice as much."""

_MAX_LOSS = 0.4  # chosen on room_1, room_7
"""Largest loss on these photos, in dB, whatever goes."""

_PIXELS_PER_GAUSSIAN = 8  # chosen on museum_room
"""Pixels of the object, on all its sides, for each Gaussian that it gets at most."""

_SIDES = 3
"""Surface of an object in pixels, relative to its pixels in one photo at the median."""

_MAX_GROWTH = 6
"""Largest number of Gaussians, relative to those that the object has, where the photos are little finer than those that
the scene was trained on. Finer photos allow more, by their pixels."""

_MAX_GAUSSIANS = 300_000
"""Largest number of Gaussians, where the object has fewer: viewers draw all of it, and a file takes 30 to 70 MB."""

_PIXELS_SEEN = 100
"""Pixels that all steps together compare, for each Gaussian that there may be: fewer would not determine it."""

_PIXELS_FOR_STEPS = 400_000
"""Pixels of the object in one photo up to which `SegmentSettings.detail_steps` are enough. Larger objects get more, by
the root of their pixels."""

_MAX_MORE_STEPS = 3
"""Largest number of steps, relative to that."""

_PREPARATION = 0.2
"""Share of the time in which the crops are made, for the progress."""


@dataclass(frozen=True)
class DetailResult:
    """The result of detailing an object.

    Attributes
    ----------
    detailed : Detailed or None
        None when it was not kept.
    record : dict
        Figures for the object's record: ``kept``, ``why`` not, ``photos``, ``validation``, ``reduced`` photos and the
        ``scale`` that they were read at, relative to their own, ``pixels`` of the object at the median, ``steps``,
        ``gaussians``, ``psnr`` before and after, the ``device`` of the steps, ``seconds``.
    """

    detailed: Detailed | None
    record: dict[str, Any]

    @property
    def sentence(self) -> str:
        """The sentence for the user."""
        record = self.record
        if not record["kept"]:
            return f"The object stays as it is in the scene: {record['why']}."
        before, after = record["psnr"]
        text = f"{after - before:+.1f} dB on photos that were left out, {record['gaussians'][1]:,} Gaussians"
        return text + (f"; {record['reduced']} photos were read smaller" if record["reduced"] else "")


def detail_object(
    views: Views,
    photos: DetailPhotos,
    members: Mask,
    settings: SegmentSettings,
    *,
    should_stop: StopCheck,
    tell: Callable[[float, float | None], None] = lambda done, seconds_left: None,
) -> DetailResult:
    """Train an object's Gaussians on the parts of the photos that show it.

    Parameters
    ----------
    members : array of shape [N], bool
    settings : SegmentSettings
        Of them, `detail_steps`.
    tell : callable
        Called with the fraction that is done, 0 to 1, and the seconds that are left where they are known.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    PhotoError
        When a photo cannot be read.

    Notes
    -----
    Let s be the share of a pixel that the members contribute in the whole scene. The coverage of the object alone is to
    be (s - 0.3) / 0.4, clipped to [0, 1], and 1 inside its outline. Where it covers more alone, and has the colours of
    the photo there, it keeps that. Pixels in which other Gaussians are clearly in front of the object do not count.
    Colours come from the photos alone. The result is kept when it is better on the test photos, which neither the scene
    nor the detail was trained on. Members that the photos show beside the object are left out: they are drawn with the
    rest of the scene, and what they show inside of the outline is for the others to show. Figures: docs/detail.md.
    """
    started = time.perf_counter()
    record: dict[str, Any] = {"kept": False, "steps": settings.detail_steps}
    if settings.detail_steps == 0 or not members.any():
        return DetailResult(None, {**record, "why": "no steps were asked for" if members.any() else "it is empty"})
    cut = _cut(views, photos, members, settings.detail_steps, should_stop, lambda done: tell(_PREPARATION * done, None))
    if len(cut.training) < _MIN_PHOTOS:
        why = f"only {len(cut.training)} training photos show it, and it needs {_MIN_PHOTOS}"
        return DetailResult(None, {**record, "why": why})
    detail, parents = _trained(
        views, cut, should_stop, lambda done, left: tell(_PREPARATION + (1 - _PREPARATION) * done, left)
    )
    judged = _judged(views, cut, detail)
    record |= cut.record | judged.record | {
        "device": "card" if views.scene.backend == "gpu" else "processor",
        "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip
    if judged.kept is None:
        return DetailResult(None, {**record, "why": judged.why})
    if judged.kept is not detail:
        parents = np.arange(len(judged.kept))
    order = np.argsort(parents, kind="stable")
    means = views.scene.gaussians.means[cut.rows]
    kept = Detailed(cut.rows.astype(np.int32), means, cut.own.astype(np.int32)[parents[order]], judged.kept[order])
    return DetailResult(kept, {**record, "kept": True})


class _Cut(NamedTuple):
    """Input of the training of detail: of the members `rows`, `own`; their photos, and those that decide."""

    rows: NDArray[np.intp]
    own: NDArray[np.intp]
    training: list[DetailCrop]
    validation: list[DetailCrop]
    plan: DetailPlan
    record: dict[str, Any]


def _cut(
    views: Views, photos: DetailPhotos, members: Mask, n_steps: int, should_stop: StopCheck,
    tell: Callable[[float], None],
) -> _Cut:  # fmt: skip
    """Cut the object out of the photos that show it, and plan the training; `_Cut.training` may be too few."""
    rows = np.flatnonzero(members)
    facing = views.facing(np.median(views.scene.gaussians.means[rows], axis=0))
    cameras = spread_cameras([one for one in facing if one.photo not in photos.held_out], _MAX_PHOTOS)
    tests = spread_cameras([one for one in facing if one.photo in photos.held_out], _MAX_VALIDATION)
    cutter = DetailCutter(views, photos, members, [*cameras, *tests], should_stop)
    own = np.flatnonzero(cutter.left)
    plan = DetailPlan(_steps(n_steps, list(cutter.n_shown.values())), len(rows))
    crops: list[DetailCrop] = []
    for crop in cutter.crops(plan.n_compared):
        if should_stop():
            raise Cancelled("Stopped while detailing; nothing was stored.")
        crops.append(crop)
        tell(len(crops) / len(cutter.n_shown))
    crops.sort(key=lambda crop: crop.photo)
    training, validation = ([one for one in crops if (one.photo in photos.held_out) is held] for held in (False, True))
    if len(training) < _MIN_PHOTOS:
        return _Cut(rows, own, training, validation, plan, {})
    training = _weighted(training)
    if not validation:
        training, validation = _divided(training)
    n_pixels = float(np.median([crop.pixels_of(crop.inside) for crop in training]))
    plan = replace(plan, max_gaussians=_max_gaussians(plan, len(own), n_pixels, cutter.finer))
    record = {
        "photos": len(training), "validation": [crop.photo for crop in validation], "reduced": cutter.n_reduced,
        "scale": round(cutter.scale, 3), "pixels": round(n_pixels), "left_out": len(rows) - len(own),
        "steps": plan.steps,
    }  # fmt: skip
    return _Cut(rows, own, training, validation, plan, record)


def _trained(
    views: Views, cut: _Cut, should_stop: StopCheck, tell: Callable[[float, float | None], None]
) -> tuple[Gaussians, NDArray[np.int64]]:
    """Return what `train_detail` returns, of the processor where a card fails that is not demanded."""
    gaussians = views.scene.gaussians
    own, others = (
        replace(gaussians[one], features=None) for one in (cut.own, np.delete(np.arange(len(gaussians)), cut.own))
    )

    def train() -> tuple[Gaussians, NDArray[np.int64]]:
        return train_detail(
            own, others, cut.training, cut.plan, backend=views.scene.backend, should_stop=should_stop, tell=tell
        )

    try:
        return train()
    except EnvironmentProblem as problem:
        views.scene.leave_card(problem)
        return train()


class _Judged(NamedTuple):
    """The Gaussians that are kept of an object, none if it stays as it is in the scene; why; and figures."""

    kept: Gaussians | None
    why: str
    record: dict[str, Any]


def _judged(views: Views, cut: _Cut, detail: Gaussians) -> _Judged:
    """Compare the detail with the object as it is in the scene, in the photos that decide.

    If it is not kept, what was trained may still be better as it is in the scene, without what was left out.
    """
    given, own = (replace(views.scene.gaussians[rows], features=None) for rows in (cut.rows, cut.own))
    before = _scores(views.scene.with_gaussians(given), cut.validation)
    refused = None
    for one in (detail, own) if len(own) < len(given) else (detail,):
        after = _scores(views.scene.with_gaussians(one), cut.validation)
        gain = after.psnr - before.psnr
        record = {
            "gaussians": [len(given), len(one)], "trained": one is detail,
            "psnr": [round(before.psnr, 2), round(after.psnr, 2)],
            "beyond": [round(before.beyond, 4), round(after.beyond, 4)],
        }  # fmt: skip
        if _is_better(before, after):
            return _Judged(one, "", record)
        refused = refused or _Judged(None, f"photos that were left out show no gain ({gain:+.1f} dB)", record)
    assert refused is not None, "at least the detail was compared"
    return refused


def _steps(n_steps: int, n_shown: Sequence[float]) -> int:
    """Return the steps of an object that has so many pixels in the photos that show it."""
    typical = float(np.median(n_shown)) if n_shown else 0.0
    return round(n_steps * min(_MAX_MORE_STEPS, max(1.0, math.sqrt(typical / _PIXELS_FOR_STEPS))))


def _max_gaussians(plan: DetailPlan, n: int, n_pixels: float, finer: float) -> int:
    """Return the largest number of Gaussians of an object of `n`, and of `n_pixels` in one crop.

    `finer` is the scale of the crops relative to that of the scene's training.
    """
    surface = max(n, _SIDES * n_pixels / _PIXELS_PER_GAUSSIAN)
    determined = max(_MAX_GROWTH * n, plan.n_compared / _PIXELS_SEEN)
    allowed = max(n, _MAX_GAUSSIANS)
    return round(min(surface, determined, allowed, max(_MAX_GROWTH, finer**2) * n))


class _Scores(NamedTuple):
    """PSNR in dB where photos show an object, and its coverage outside of its outline, over the pixels inside."""

    psnr: float
    beyond: float


def _scores(alone: Scene, crops: Sequence[DetailCrop]) -> _Scores:
    """Compare an object alone over black with photos, in windows of `crops`, and with its outline there."""
    total, count, beyond, inside = 0.0, 0, 0.0, 0.0
    for part in (window for crop in crops for window in tiles(crop, _JUDGED_PIXELS)):
        rendered = alone.render(part.camera, color=True)
        difference = np.clip(rendered.channels * part.gain, 0, 1) - part.pixels / np.float32(255)
        total += float(np.square(difference[part.judged], dtype=np.float64).sum())
        count += 3 * int(part.judged.sum())
        beyond += float(rendered.alpha[part.known & (part.alpha == 0)].sum(dtype=np.float64))
        inside += float(part.alpha.sum(dtype=np.float64))
    return _Scores(-10.0 * math.log10(max(total / max(count, 1), 1e-10)), beyond / max(inside, 1.0))


def _is_better(before: _Scores, after: _Scores) -> bool:
    """Return whether an object is closer to the photos, or about as close and covers less outside of its outline."""
    gain = after.psnr - before.psnr
    share = max(after.beyond, _NOTHING_OUTSIDE) / max(before.beyond, _NOTHING_OUTSIDE)
    if share >= _CLEARLY_LESS:
        return gain >= _MIN_GAIN
    allowed = -_LOSS_FOR_HALF * math.log2(share) if share <= 0.5 else _MIN_GAIN
    return gain >= -min(_MAX_LOSS, allowed)


def _divided(crops: Sequence[DetailCrop]) -> tuple[list[DetailCrop], list[DetailCrop]]:
    """Return crops to train on and to decide by, where no test photo shows the object.

    The scene was trained on the second ones too, so that they favour the object as it is.
    """
    n_validation = min(_MAX_VALIDATION, max(1, round(_VALIDATION_SHARE * len(crops))))
    chosen = {round((i + 0.5) * len(crops) / n_validation - 0.5) for i in range(n_validation)}
    return [one for i, one in enumerate(crops) if i not in chosen], [crops[i] for i in sorted(chosen)]


def _weighted(crops: Sequence[DetailCrop]) -> list[DetailCrop]:
    """Return crops whose weights are larger where the photo is near and sharp."""
    sharpness = []
    for crop in crops:
        reduction = min(1.0, math.sqrt(_SHARPNESS_PIXELS / math.prod(crop.shape)))
        small = cv2.resize(crop.pixels, None, fx=reduction, fy=reduction, interpolation=cv2.INTER_AREA)
        gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
        sharpness.append(float(np.abs(cv2.Laplacian(gray, cv2.CV_32F)).mean()))
    middle = max(float(np.median(sharpness)), 1e-6)
    return [
        replace(crop, weight=math.sqrt(crop.weight) * float(np.clip(sharp / middle, 0.5, 2.0)))
        for crop, sharp in zip(crops, sharpness, strict=True)
    ]
