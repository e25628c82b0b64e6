"""The cases of training. Each says beforehand whether it must finish, how well at least, or with what it is refused."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ..training import TrainingResult
from ..training.settings import PRESETS, TrainingSettings
from .training_floors import EASIER, HOLES, LEARNT, SAME, SIMILAR, Floor, flat, known, undisturbed
from .training_measure import Ending, TrainingFinding, measured_run
from .training_rules import continues_exactly, continues_without_memory, stays_empty
from .training_scenes import FOCAL, SETTINGS, Capture, TrainingInput, faster, known_capture, training_input

__all__ = ["TRAINING_CASES", "TrainingCase"]

Problems = Callable[[TrainingResult, TrainingSettings], list[str]]


@dataclass(frozen=True)
class TrainingCase:
    """A row of the table.

    Attributes
    ----------
    name, what : str
    expected : {"finishes", "warns", "refused"}
    run : callable
    floor : Floor or None
        When it must finish; see `training_floors`.
    sentence : str
        When it must warn or be refused: what the sentence holds, behind an error's type.
    """

    name: str
    what: str
    expected: Ending
    run: Callable[[], TrainingFinding]
    floor: Floor | None = None
    sentence: str = ""


def _no_more(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    return []


def _input(capture: Callable[[], Capture], settings: TrainingSettings) -> tuple[TrainingInput, TrainingSettings]:
    return training_input(capture(), settings), settings


def _finishes(
    name: str,
    what: str,
    capture: Callable[[], Capture],
    floor: Floor,
    settings: TrainingSettings = SETTINGS,
    *,
    more: Problems = _no_more,
) -> TrainingCase:
    run = partial(measured_run, partial(_input, capture, settings), more)
    return TrainingCase(name, what, "finishes", run, floor)


def _started(change: Callable[[TrainingInput], TrainingInput]) -> Callable[[], TrainingFinding]:
    """Return a run whose input is changed just before training."""
    return lambda: measured_run(lambda: (change(training_input(known_capture()[0], SETTINGS)), SETTINGS))


def _refused(
    name: str, what: str, error: str, words: str, change: Callable[[TrainingInput], TrainingInput]
) -> TrainingCase:
    return TrainingCase(name, what, "refused", _started(change), sentence=f"{error}: …{words}")


def _known() -> Capture:
    return known_capture()[0]


def _before_nothing() -> Capture:
    return known_capture(ground=False)[0]


ALL = slice(None)
HALF = slice(None, None, 2)
FEW = [3, 4, 5]


def _rates() -> list[TrainingCase]:
    """Return cases of learning rates, those of the preset ``test`` (and ``standard``) multiplied."""

    def settings(factor: float) -> TrainingSettings:
        return faster(SETTINGS, factor * PRESETS["test"].lr_sh / SETTINGS.lr_sh)

    too_high = partial(measured_run, partial(_input, _known, settings(100.0)))
    return [
        _finishes("rates_x10", "learning rates ten times the preset's", _known, flat(_known), settings(10.0)),
        TrainingCase(
            "rates_x100", "learning rates a hundred times the preset's: nothing is learnt, and that is said", "warns",
            too_high, sentence="…than one flat colour",
        ),
    ]  # fmt: skip


def _photos() -> list[TrainingCase]:
    def of(numbers: Sequence[int], *held_out: int) -> Callable[[], Capture]:
        return lambda: _known().pick(numbers, held_out=frozenset(held_out))

    def exposed(gain: float) -> Callable[[], Capture]:
        return lambda: _known().exposed([gain] * 12, points=gain)

    two = of([0, 1, 2], 1)
    twice = [i for i in range(12) for _ in range(2)]
    return [
        _finishes("one_photo", "one photo, no points; measured on itself", lambda: of([0])().without_points(),
                  undisturbed(EASIER, points=False)),
        _finishes("two_photos", "two photos 60 degrees apart; measured half-way", two, flat(two)),
        _finishes("duplicated_photos", "every photo twice", of(twice, 4, 5, 12, 13, 20, 21), undisturbed(SIMILAR)),
        *[
            _finishes(f"flat_{name}", f"photos of nothing but {name}, no points", partial(_flat, level),
                      undisturbed(HOLES, points=False))
            for name, level in (("black", 0), ("gray", 128), ("white", 255))
        ],
        _finishes("black_background", "the balls before nothing", _before_nothing, undisturbed(SIMILAR),
                  replace(SETTINGS, lambda_opacity=PRESETS["standard"].lambda_opacity), more=stays_empty),
        _finishes("over_exposed", "photos 3 times as bright, most of them white", exposed(3.0), flat(exposed(3.0))),
        _finishes("under_exposed", "photos a tenth as bright, 25 levels", exposed(0.1), flat(exposed(0.1))),
        _finishes("mixed_exposure", "photos half to twice as bright, exposure learnt", _mixed, flat(_mixed),
                  replace(SETTINGS, exposure=True)),
    ]  # fmt: skip


def _flat(level: int) -> Capture:
    return _known().flat(level)


def _mixed() -> Capture:
    training, _ = _known().split()
    gains = np.ones(12)
    gains[training] = 2.0 ** np.random.default_rng(0).permutation(np.linspace(-1.0, 1.0, len(training)))
    return _known().exposed(list(gains))


def _wide_lens() -> Capture:
    return replace(_known(), focal=1.2 * FOCAL)


def _shaken() -> Capture:
    """Return the capture with each camera turned about its x and y axes by 5 pixels each, normally distributed."""
    capture = _known()
    viewmats = capture.viewmats.copy()
    for viewmat, turn in zip(viewmats, np.random.default_rng(0).normal(size=(12, 2)) * 5.0 / FOCAL, strict=True):
        viewmat[:3] = Rotation.from_rotvec([*turn, 0.0]).as_matrix() @ viewmat[:3]
    return replace(capture, viewmats=viewmats)


def _frames() -> list[TrainingCase]:
    utm = (500_000.137, 4_500_000.271, 120.052)
    return [
        _finishes("focal_20_percent_off", "focal length 20 % too long", _wide_lens, known(_wide_lens)),
        _finishes("poses_5_pixels_off", "cameras turned by 5 pixels of 48 each", _shaken, flat(_shaken)),
        _finishes("world_1e+6", "a world 1e6 times as wide", lambda: _known().moved(scale=1e6), undisturbed(SAME)),
        _finishes("world_1e-6", "a world 1e-6 times as wide", lambda: _known().moved(scale=1e-6), undisturbed(SAME)),
        _finishes("world_utm", "UTM coordinates, 5e5 m east, 4.5e6 m north, of photos 25 cm around a small thing",
                  lambda: _known().moved(scale=0.1, offset=utm), undisturbed(SAME)),
    ]  # fmt: skip


def _one_point() -> Capture:
    return replace(_known(), points=_known().points[:1], colors=_known().colors[:1])


def _points_and_budget() -> list[TrainingCase]:
    budget = partial(replace, SETTINGS)
    vast = budget(max_gaussians=2_000_000, steps=360, grow_interval=30)
    return [
        _finishes("no_points", "no sparse points", lambda: _known().without_points(), flat(_known)),
        _finishes("one_point", "one sparse point", _one_point, flat(_known)),
        _finishes("budget_10", "a budget of 10 Gaussians", _known, flat(_known), budget(max_gaussians=10)),
        _finishes("budget_2_million", "a budget of 2,000,000 Gaussians, which nothing needs", _known,
                  undisturbed(SIMILAR), vast, more=_grows_slowly),
    ]  # fmt: skip


def _grows_slowly(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    """Return what is wrong when Gaussians are added faster than they can settle: 1.3 times at each growth at most."""
    n_growths = settings.steps * settings.grow_until / settings.grow_interval
    first, last = result.curve[0].n_gaussians, result.curve[-1].n_gaussians
    problems = [f"{last} Gaussians came of {first} in {n_growths:.0f} growths"] if last > first * 1.3**n_growths else []
    return problems + (["nothing has grown"] if last <= first else [])


def _spoilt(array: str, value: float, given: TrainingInput) -> TrainingInput:
    return given.with_start(**{array: ([3], value)})


def _starts() -> list[TrainingCase]:
    def finishes(name: str, what: str, floor: Floor, **rows: tuple[Sequence[int] | slice, float]) -> TrainingCase:
        return TrainingCase(name, what, "finishes", _started(lambda given: given.with_start(**rows)), floor)

    not_finite = [
        _refused(f"start_{array}_{value}", f"{value} in one Gaussian's {array} at the start", "NumericalError",
                 f"`{array}` of 1 of the 400 Gaussians to start from is not finite", partial(_spoilt, array, value))
        for array, value in (("means", np.nan), ("log_scales", np.inf), ("quats", np.nan), ("opacity_logits", -np.inf),
                             ("sh", np.nan))
    ]  # fmt: skip
    return [
        finishes("opacity_all_1", "all opacity logits 100: sigmoid is 1, its gradient 0 in float32", flat(_known),
                 opacity_logits=(ALL, 100.0)),
        finishes("opacity_half_0", "half of the opacity logits -100: opacity and gradient are 0", undisturbed(SIMILAR),
                 opacity_logits=(HALF, -100.0)),
        _refused("opacity_all_0", "all opacity logits -100: nothing is seen, nothing can be learnt", "TrainingError",
                 "all 400 Gaussians became transparent",
                 lambda given: given.with_start(opacity_logits=(ALL, -100.0))),
        finishes("start_scales_1e39", "three Gaussians whose scale float32 cannot hold", undisturbed(SIMILAR),
                 log_scales=(FEW, 90.0)),
        finishes("start_means_1e30", "three Gaussians 1e30 away", undisturbed(SIMILAR), means=(FEW, 1e30)),
        finishes("start_quats_0", "three rotations of zeros", undisturbed(SIMILAR), quats=(FEW, 0.0)),
        *not_finite,
    ]  # fmt: skip


def _cut(given: TrainingInput, number: int) -> TrainingInput:
    views = list(given.views)
    views[number] = replace(views[number], pixels=views[number].pixels[:30])
    return replace(given, views=tuple(views))


def _refusals() -> list[TrainingCase]:
    heavy = partial(measured_run, partial(_input, _known, replace(SETTINGS, lambda_opacity=1e25)))
    return [
        _refused("other_size", "a photo of 48 x 30 pixels, its camera of 48 x 36", "TrainingError",
                 "03.png has 48 x 30 pixels, its camera 48 x 36", partial(_cut, number=3)),
        _refused("other_size_held_out", "the same of a photo that is held out", "TrainingError",
                 "02.png has 48 x 30 pixels, its camera 48 x 36", partial(_cut, number=2)),
        _refused("no_photo", "all photos held out", "TrainingError", "no photo to train on",
                 lambda given: replace(given, views=tuple(view for view in given.views if view.held_out))),
        _refused("no_start", "no Gaussians to start from", "TrainingError", "no Gaussians to start from",
                 lambda given: replace(given, start=given.start[:0])),
        TrainingCase("weight_1e25", "a weight in the loss of 1e25: squares of gradients overflow in Adam", "refused",
                     heavy, sentence="NumericalError: …No gradient of any Gaussian is finite"),
        TrainingCase("memory_full", "no more memory from step 45 on; with memory again, the run goes on to the same "
                     "Gaussians", "refused", continues_without_memory,
                     sentence="EnvironmentProblem: …The memory of this machine is full"),
    ]  # fmt: skip


TRAINING_CASES: tuple[TrainingCase, ...] = (
    _finishes("undisturbed", "12 photos, 9 trained on; 400 Gaussians; 120 steps", _known, flat(_known, above=LEARNT)),
    *_rates(),
    *_photos(),
    *_frames(),
    *_points_and_budget(),
    *_starts(),
    *_refusals(),
    TrainingCase("stopped", "stopped four times: the same Gaussians, bit by bit, as if not", "finishes",
                 functools.partial(continues_exactly, killed=False), flat(_known)),
    TrainingCase("killed", "killed four times, so between two checkpoints: the same Gaussians", "finishes",
                 functools.partial(continues_exactly, killed=True), flat(_known)),
)  # fmt: skip
"""In the order of the table."""
