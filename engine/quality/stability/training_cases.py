"""The cases of training, each with its expected ending, and with its lowest PSNR or its message."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ...training import TrainingResult
from ...training.settings import MAX_GROW_FACTOR, PRESETS, TrainingSettings
from .training_floors import (
    ABOVE_FLAT_DB,
    EASIER_DB,
    OVERFIT_DB,
    SAME_RUN_DB,
    SIMILAR_RUN_DB,
    UNTEXTURED_DB,
    Floor,
    flat_floor,
    known_floor,
    training_psnr,
    undisturbed_floor,
)
from .training_measure import Ending, TrainingFinding, measure_training
from .training_rules import resumes_after_memory_error, resumes_exactly, stays_empty
from .training_scenes import (
    FOCAL,
    SETTINGS,
    Capture,
    TrainingInput,
    known_capture,
    scale_learning_rates,
    training_input,
)

Problems = Callable[[TrainingResult, TrainingSettings], list[str]]


@dataclass(frozen=True)
class TrainingCase:
    """A row of the table.

    Attributes
    ----------
    name, what : str
        Name and description.
    expected : {"finishes", "warns", "refused"}
    run : callable
    floor : Floor or None
        Lowest PSNR, for a case that must finish; see `training_floors`.
    message : str
        Part of the message, for a case that must warn or be refused. An error's type comes first, then "…".
    """

    name: str
    what: str
    expected: Ending
    run: Callable[[], TrainingFinding]
    floor: Floor | None = None
    message: str = ""


def _no_problems(result: TrainingResult, settings: TrainingSettings) -> list[str]:
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
    check: Problems = _no_problems,
) -> TrainingCase:
    run = partial(measure_training, partial(_input, capture, settings), check)
    return TrainingCase(name, what, "finishes", run, floor)


def _run_with(change: Callable[[TrainingInput], TrainingInput]) -> Callable[[], TrainingFinding]:
    """Return a run of the undisturbed capture whose input is changed just before training."""
    return lambda: measure_training(lambda: (change(training_input(known_capture()[0], SETTINGS)), SETTINGS))


def _refused(
    name: str, what: str, error: str, words: str, change: Callable[[TrainingInput], TrainingInput]
) -> TrainingCase:
    return TrainingCase(name, what, "refused", _run_with(change), message=f"{error}: …{words}")


def _known() -> Capture:
    """Return the undisturbed capture."""
    return known_capture()[0]


def _without_floor() -> Capture:
    """Return the undisturbed capture without its floor, in front of black."""
    return known_capture(ground=False)[0]


ALL = slice(None)
HALF = slice(None, None, 2)
FEW = [3, 4, 5]
"""Rows of the start's arrays that a case changes."""
_FITTED_DB = 40.0
"""PSNR at which the RMS error is 1 %."""


def _rates() -> list[TrainingCase]:
    """Return cases with multiples of the learning rates of the preset ``test``, which are those of ``standard``."""

    def settings(factor: float) -> TrainingSettings:
        return scale_learning_rates(SETTINGS, factor * PRESETS["test"].optimiser.lr_sh / SETTINGS.optimiser.lr_sh)

    # At a hundred times the rates, rounding decides whether something is learnt: the ending differs by machine.
    too_high = partial(measure_training, partial(_input, _known, settings(1000.0)))
    return [
        _finishes("rates_x10", "learning rates ten times the preset's", _known, flat_floor(_known), settings(10.0)),
        TrainingCase(
            "rates_x1000",
            "learning rates a thousand times the preset's: nothing is learnt, and a warning says so",
            "warns",
            too_high,
            message="…than one flat colour",
        ),
    ]


def _photos() -> list[TrainingCase]:
    def photos(numbers: Sequence[int], *held_out: int) -> Callable[[], Capture]:
        return lambda: _known().select_photos(numbers, held_out=frozenset(held_out))

    def exposed(gain: float) -> Callable[[], Capture]:
        return lambda: _known().with_gains([gain] * 12, points=gain)

    two, loss = photos([0, 1, 2], 1), PRESETS["standard"].loss
    twice = [i for i in range(12) for _ in range(2)]
    return [
        _finishes(
            "one_photo",
            "one photo, no points; evaluated on itself",
            lambda: photos([0])().without_points(),
            undisturbed_floor(EASIER_DB, points=False),
        ),
        _finishes("two_photos", "two photos 60 degrees apart; evaluated half-way", two, flat_floor(two)),
        _finishes(
            "duplicated_photos",
            "every photo twice",
            photos(twice, 4, 5, 12, 13, 20, 21),
            undisturbed_floor(SIMILAR_RUN_DB),
        ),
        *[
            _finishes(
                f"flat_{name}",
                f"photos that are completely {name}, no points",
                partial(_flat, level),
                undisturbed_floor(UNTEXTURED_DB, points=False),
            )
            for name, level in (("black", 0), ("gray", 128), ("white", 255))
        ],
        _finishes(
            "black_background",
            "the balls without a floor",
            _without_floor,
            undisturbed_floor(SIMILAR_RUN_DB),
            SETTINGS.changed(lambda_opacity=loss.lambda_opacity, lambda_opacity_end=loss.lambda_opacity_end),
            check=stays_empty,
        ),
        _finishes(
            "over_exposed", "photos 3 times as bright, most of them white", exposed(3.0), flat_floor(exposed(3.0))
        ),
        _finishes("under_exposed", "photos a tenth as bright, 25 levels", exposed(0.1), flat_floor(exposed(0.1))),
        _finishes(
            "mixed_exposure",
            "photos half to twice as bright, exposure learnt",
            _mixed,
            flat_floor(_mixed),
            SETTINGS.changed(exposure=True),
        ),
    ]


def _flat(level: int) -> Capture:
    return _known().with_flat_photos(level)


def _mixed() -> Capture:
    training, _ = _known().split()
    gains = np.ones(12)
    gains[training] = 2.0 ** np.random.default_rng(0).permutation(np.linspace(-1.0, 1.0, len(training)))
    return _known().with_gains(list(gains))


def _wide_lens() -> Capture:
    return replace(_known(), focal=1.2 * FOCAL)


def _rotated_cameras() -> Capture:
    """Return the capture with each camera rotated about its x and y axes (standard deviation 5 pixels each)."""
    capture = _known()
    viewmats = capture.viewmats.copy()
    for viewmat, turn in zip(viewmats, np.random.default_rng(0).normal(size=(12, 2)) * 5.0 / FOCAL, strict=True):
        viewmat[:3] = Rotation.from_rotvec([*turn, 0.0]).as_matrix() @ viewmat[:3]
    return replace(capture, viewmats=viewmats)


def _frames() -> list[TrainingCase]:
    utm = (500_000.137, 4_500_000.271, 120.052)
    return [
        _finishes("focal_20_percent_off", "focal length 20 % too long", _wide_lens, known_floor(_wide_lens)),
        _finishes(
            "poses_5_pixels_off",
            "cameras rotated by 5 of 48 pixels each",
            _rotated_cameras,
            flat_floor(_rotated_cameras),
        ),
        _finishes(
            "world_1e+6",
            "a world 1e6 times as large",
            lambda: _known().transformed(scale=1e6),
            undisturbed_floor(SAME_RUN_DB),
        ),
        _finishes(
            "world_1e-6",
            "a world 1e-6 times as large",
            lambda: _known().transformed(scale=1e-6),
            undisturbed_floor(SAME_RUN_DB),
        ),
        _finishes(
            "world_utm",
            "UTM coordinates, 5e5 m east, 4.5e6 m north, with cameras 25 cm from a small object",
            lambda: _known().transformed(scale=0.1, offset=utm),
            undisturbed_floor(SAME_RUN_DB),
        ),
    ]


def _one_point() -> Capture:
    return replace(_known(), points=_known().points[:1], colors=_known().colors[:1])


def _points_and_budget() -> list[TrainingCase]:
    budget = SETTINGS.changed
    vast = budget(max_gaussians=2_000_000, steps=360, grow_interval=60)
    return [
        _finishes("no_points", "no sparse points", lambda: _known().without_points(), flat_floor(_known)),
        _finishes("one_point", "one sparse point", _one_point, flat_floor(_known)),
        _finishes("budget_10", "a budget of 10 Gaussians", _known, flat_floor(_known), budget(max_gaussians=10)),
        _finishes(
            "budget_2_million",
            "a budget of 2,000,000 Gaussians, far more than the scene needs",
            _known,
            undisturbed_floor(OVERFIT_DB),
            vast,
            check=_uses_the_budget,
        ),
    ]


def _uses_the_budget(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    """Check that Gaussians are added, by no more than a growth may, and that they fit the training photos.

    With more values than the photos have, they must reproduce them to an RMS error of 1 %. Rounding and random draws
    change this PSNR far less than that of the held-out photos: 43.3 to 45.0 dB in 20 runs.
    """
    n_growths = int(settings.schedule.steps * settings.growth.grow_until) // settings.growth.grow_interval
    first, last = result.curve[0].n_gaussians, result.curve[-1].n_gaussians
    most = first * MAX_GROW_FACTOR**n_growths
    problems = [f"{first} Gaussians became {last} in {n_growths} growths"] if last > most else []
    problems += ["no Gaussians were added"] if last <= first else []
    psnr = training_psnr(result.gaussians, _known())
    return problems + ([f"{psnr:.2f} dB on the training photos, less than {_FITTED_DB:g}"] if psnr < _FITTED_DB else [])


def _with_value(array: str, value: float, inputs: TrainingInput) -> TrainingInput:
    return inputs.with_start(**{array: ([3], value)})


def _starts() -> list[TrainingCase]:
    def finishes(name: str, what: str, floor: Floor, **rows: tuple[Sequence[int] | slice, float]) -> TrainingCase:
        return TrainingCase(name, what, "finishes", _run_with(lambda inputs: inputs.with_start(**rows)), floor)

    not_finite = [
        _refused(
            f"start_{array}_{value}",
            f"{value} in one Gaussian's {array} at the start",
            "NumericalError",
            f"`{array}` of 1 of the 400 Gaussians to start from is not finite",
            partial(_with_value, array, value),
        )
        for array, value in (
            ("means", np.nan),
            ("log_scales", np.inf),
            ("quats", np.nan),
            ("opacity_logits", -np.inf),
            ("sh", np.nan),
        )
    ]
    return [
        finishes(
            "opacity_all_1",
            "all opacity logits 100: sigmoid is 1, its gradient 0 in float32",
            flat_floor(_known),
            opacity_logits=(ALL, 100.0),
        ),
        finishes(
            "opacity_half_0",
            "half of the opacity logits -100: opacity and gradient are 0",
            undisturbed_floor(SIMILAR_RUN_DB),
            opacity_logits=(HALF, -100.0),
        ),
        _refused(
            "opacity_all_0",
            "all opacity logits -100: nothing is visible, nothing can be learnt",
            "TrainingError",
            "all 400 Gaussians became transparent",
            lambda inputs: inputs.with_start(opacity_logits=(ALL, -100.0)),
        ),
        finishes(
            "start_scales_1e39",
            "three Gaussians whose scale overflows in float32",
            undisturbed_floor(SIMILAR_RUN_DB),
            log_scales=(FEW, 90.0),
        ),
        finishes("start_means_1e30", "three Gaussians 1e30 away", undisturbed_floor(SIMILAR_RUN_DB), means=(FEW, 1e30)),
        finishes(
            "start_quats_0",
            "three rotations with quaternions of zeros",
            undisturbed_floor(SIMILAR_RUN_DB),
            quats=(FEW, 0.0),
        ),
        *not_finite,
    ]


def _cut(inputs: TrainingInput, number: int) -> TrainingInput:
    views = list(inputs.views)
    views[number] = replace(views[number], pixels=views[number].pixels[:30])
    return replace(inputs, views=tuple(views))


def _refusals() -> list[TrainingCase]:
    large_weight = partial(
        measure_training, partial(_input, _known, SETTINGS.changed(lambda_opacity=1e25, lambda_opacity_end=1e25))
    )
    return [
        _refused(
            "other_size",
            "a photo of 48 x 30 pixels, its camera of 48 x 36",
            "TrainingError",
            "03.png has 48 x 30 pixels, its camera 48 x 36",
            partial(_cut, number=3),
        ),
        _refused(
            "other_size_held_out",
            "the same for a held-out photo",
            "TrainingError",
            "02.png has 48 x 30 pixels, its camera 48 x 36",
            partial(_cut, number=2),
        ),
        _refused(
            "no_photo",
            "all photos held out",
            "TrainingError",
            "no photo to train on",
            lambda inputs: replace(inputs, views=tuple(view for view in inputs.views if view.held_out)),
        ),
        _refused(
            "no_start",
            "no Gaussians to start from",
            "TrainingError",
            "no Gaussians to start from",
            lambda inputs: replace(inputs, start=inputs.start[:0]),
        ),
        TrainingCase(
            "weight_1e25",
            "a weight of 1e25 in the loss: squares of gradients overflow in Adam",
            "refused",
            large_weight,
            message="NumericalError: …No gradient of any Gaussian is finite",
        ),
        TrainingCase(
            "memory_full",
            "memory is limited from step 45 on; resumed without the limit, the run ends with the same Gaussians",
            "refused",
            resumes_after_memory_error,
            message="EnvironmentProblem: …The memory of this machine is full",
        ),
    ]


TRAINING_CASES: tuple[TrainingCase, ...] = (
    _finishes(
        "undisturbed",
        "12 photos, 9 trained on; 400 Gaussians; 120 steps",
        _known,
        flat_floor(_known, above=ABOVE_FLAT_DB),
    ),
    *_rates(),
    *_photos(),
    *_frames(),
    *_points_and_budget(),
    *_starts(),
    *_refusals(),
    TrainingCase(
        "stopped",
        "stopped four times: exactly the same Gaussians as without stops",
        "finishes",
        functools.partial(resumes_exactly, killed=False),
        flat_floor(_known),
    ),
    TrainingCase(
        "killed",
        "killed four times between two checkpoints: exactly the same Gaussians",
        "finishes",
        functools.partial(resumes_exactly, killed=True),
        flat_floor(_known),
    ),
)
"""All cases of training in the order of the table."""
