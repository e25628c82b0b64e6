"""The cases of the numerical suite, each with the outcome that is expected of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch

from ...rasterizer.settings import ALPHA_MAX, DET_MIN, RasterSettings
from . import loss, optimiser, rules
from .bounds import Bounds
from .georeferenced import normalised_scene, unnormalised_case
from .measure import Finding, Outcome, Reason, measure_scene
from .scenes import NAMES, Scene, facing_camera, ordinary_scene


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Attributes
    ----------
    name : str
    what : str
        Description.
    expected : {"bounded", "culled", "refused"}
    run : callable
        Function from the bounds of the case to its result.
    """

    name: str
    what: str
    expected: Outcome
    run: Callable[[Bounds], Finding]


def _rendered(name: str, what: str, scene: Callable[[], Scene], tested: slice | None = None) -> Case:
    """Return a case of a scene whose Gaussians under test are rendered within the bounds."""
    return Case(name, what, "bounded", lambda bounds: measure_scene(scene(), bounds, tested=tested))


def _culled(name: str, what: str, reason: Reason, scene: Callable[[], Scene], tested: slice) -> Case:
    """Return a case of a scene whose Gaussians under test are culled and counted under `reason`."""
    what = f"{what} ({reason})"
    return Case(name, what, "culled", lambda bounds: measure_scene(scene(), bounds, tested=tested, culled_as=reason))


ALL = slice(None)
FIRST = slice(0, 6)
"""The Gaussians under test, in front of others that are ordinary."""


def _scaled(factors: list[float], **arrays: Any) -> Scene:
    """Return an ordinary scene with the three scales of each Gaussian multiplied by `factors`."""
    scene = ordinary_scene()
    return scene.with_arrays(scales=scene.scales * torch.tensor(factors, dtype=torch.float64), **arrays)


def _needles() -> list[Case]:
    cases = []
    for power in (2, 3, 4, 5, 6):
        aspect = 10.0**power
        cases += [
            _rendered(
                f"needle_1e{power}",
                f"needles 1:1e{power}, one or two pixels wide, longer than the picture",
                partial(_scaled, [aspect, 1.0, 1.0]),
                ALL,
            ),
            _rendered(
                f"needle_thin_1e{power}",
                f"needles 1:1e{power}, narrower than a pixel",
                partial(_scaled, [aspect**0.5, aspect**-0.5, aspect**-0.5]),
                ALL,
            ),
        ]
    return cases


def _sizes() -> list[Case]:
    cases = [
        _rendered(
            f"scale_1e{power:+d}",
            f"Gaussians of 1e{power:+d} times the scene's size",
            partial(_scaled, [10.0**power] * 3),
        )
        for power in (-7, -5, -3, -1, 1, 3, 5, 7)
    ]
    for power in (-1, 3, 7):
        cases.append(
            _rendered(
                f"world_1e{power:+d}",
                f"the whole scene, camera and near plane times 1e{power:+d}",
                partial(_world, 10.0**power),
                ALL,
            )
        )
    cases.append(
        _culled(
            "world_1e-7",
            "the whole scene times 1e-7, closer than any near plane may be",
            "near",
            lambda: _world(1e-7),
            ALL,
        )
    )
    cases.append(
        _culled(
            "scale_1e+20",
            "6 Gaussians of size 1e20, whose extent overflows in float32",
            "degenerate",
            lambda: _with_rows(scales=np.full((6, 3), 1e20)),
            FIRST,
        )
    )
    return cases


def _world(factor: float) -> Scene:
    """Return an ordinary scene multiplied by `factor`."""
    scene = ordinary_scene(camera=facing_camera())
    settings = RasterSettings(near=max(1e-4, 0.02 * factor), threads=1)
    return replace(scene.with_arrays(means=scene.means * factor, scales=scene.scales * factor), settings=settings)


def _with_rows(**rows: Any) -> Scene:
    """Return an ordinary scene with other values for its first six Gaussians."""
    scene = ordinary_scene(camera=facing_camera())
    arrays = {name: scene.tensors()[name].clone() for name in rows}
    for name, values in rows.items():
        arrays[name][FIRST] = torch.tensor(np.asarray(values, np.float64))
    return scene.with_arrays(**arrays)


def _near_plane(z: float) -> Scene:
    """Return six Gaussians at depth `z`, about 10 pixels large in the picture, in front of ordinary ones."""
    across = np.linspace(-0.2, 0.2, 6)
    size = max(abs(z), 1e-3)
    means = np.stack([across * size, -across * size, np.full(6, z)], axis=1)
    return _with_rows(means=means, scales=np.full((6, 3), 0.2 * size) * [1.0, 0.5, 0.7], opacities=np.full(6, 0.4))


def _near_cases() -> list[Case]:
    near = RasterSettings().near
    behind = [
        ("near_before_1e-6", "1e-6 in front of the near plane", near - 1e-6),
        ("near_exactly", "on the near plane", float(np.float32(near))),
        ("near_at_camera", "at the depth of the camera", 0.0),
        ("near_behind", "behind the camera", -1.0),
    ]
    beyond = [
        ("near_beyond_1e-6", "1e-6 beyond the near plane", near + 1e-6),
        ("near_beyond_1e-3", "1e-3 beyond the near plane", near + 1e-3),
    ]
    cases = [_culled(name, what, "near", partial(_near_plane, z), FIRST) for name, what, z in behind]
    cases += [_rendered(name, what, partial(_near_plane, z), FIRST) for name, what, z in beyond]
    cases.append(
        _rendered(
            "near_beyond_large",
            "1e-6 beyond the near plane and as large as the scene",
            lambda: _near_plane(near + 1e-6).with_arrays(scales=ordinary_scene().scales),
            FIRST,
        )
    )
    return cases


def _far_off(distance: float, *, needles: bool = False) -> Scene:
    """Return six Gaussians with centres `distance` to the side that are large or long enough to reach the picture."""
    angle = 0.3 + np.arange(6)
    means = np.stack([np.cos(angle) * distance, np.sin(angle) * distance, np.full(6, 3.0)], axis=1)
    scales = np.full((6, 3), 0.8 * distance)
    if needles:
        scales[:, 1:] = 0.01
    zero = np.zeros(6)
    quats = np.stack([np.cos(0.5 * angle), zero, zero, np.sin(0.5 * angle)], axis=1)
    return _with_rows(means=means, scales=scales, quats=quats, opacities=np.full(6, 0.4))


def _positions() -> list[Case]:
    return [
        _rendered("centre_10_off", "centres 10 units (4 widths) off screen", lambda: _far_off(10.0), FIRST),
        _rendered(
            "centre_40_widths_off", "centres 100 units off screen, with sizes to match", lambda: _far_off(100.0), FIRST
        ),
        _rendered(
            "centre_300_widths_off",
            "centres 1000 units off screen, with sizes to match",
            lambda: _far_off(1000.0),
            FIRST,
        ),
        _rendered(
            "needle_centre_off",
            "needles whose centres are 160,000 pixels off screen",
            lambda: _far_off(1e4, needles=True),
            FIRST,
        ),
        _culled(
            "centre_off_small",
            "small Gaussians 1000 units off screen",
            "outside",
            lambda: _far_off(1000.0).with_arrays(scales=ordinary_scene().scales),
            FIRST,
        ),
        _rendered("coincident_10000", "10,000 Gaussians at the same position", _coincident),
        _rendered(
            "equal_depths",
            "64 Gaussians of equal depth: rendered in the order of their indices",
            lambda: _equal_depths(False),
        ),
        _rendered(
            "equal_depths_reversed",
            "the same with the arrays reversed: again in the order of their indices",
            lambda: _equal_depths(True),
        ),
        Case(
            "order_of_arrays",
            "different depths, arrays shuffled: exactly the same result",
            "bounded",
            rules.array_order_does_not_matter,
        ),
        *[
            case
            for name, origin in (("500_km", 5e5), ("4500_km", 4.5e6))
            for case in (
                Case(
                    f"origin_{name}_raw",
                    f"origin {origin:g} m away, float32 without normalisation",
                    "bounded",
                    unnormalised_case(origin),
                ),
                _rendered(
                    f"origin_{name}_normalised",
                    f"origin {origin:g} m away, normalised first",
                    partial(normalised_scene, origin),
                ),
            )
        ],
    ]


def _coincident() -> Scene:
    n = 10_000
    channels = np.random.default_rng(0).normal(size=(n, 2))
    scene = ordinary_scene(1, camera=facing_camera(12, 9)).rows(torch.zeros(n, dtype=torch.long))
    scales = np.tile([0.3, 0.15, 0.2], (n, 1))
    return scene.with_arrays(
        means=np.tile([0.0, 0.0, 3.0], (n, 1)), scales=scales, opacities=np.full(n, 0.006), channels=channels
    )


def _equal_depths(reverse: bool) -> Scene:
    scene = ordinary_scene(64, camera=facing_camera())
    means = scene.means.clone()
    means[:, 2] = 3.0
    return scene.with_arrays(means=means).rows(torch.arange(63, -1, -1) if reverse else slice(None))


def _opacities() -> list[Case]:
    def logits(values: torch.Tensor) -> Scene:
        return ordinary_scene().with_arrays(opacities=torch.sigmoid(values.float()))

    cases = [
        _rendered(
            f"opacity_logit_{value:+g}",
            f"opacity sigmoid({value:g}) in float32",
            partial(logits, torch.full((24,), value)),
        )
        for value in (-5.5, 0.0, 5.0, 20.0, 40.0)
    ]
    for value in (-40.0, -20.0, -5.6):
        cases.append(
            _culled(
                f"opacity_logit_{value:+g}",
                f"opacity sigmoid({value:g}), below 1/255",
                "transparent",
                partial(logits, torch.full((24,), value)),
                ALL,
            )
        )
    cases.append(
        _rendered(
            "opacity_logits_mixed",
            "opacity logits from -40 to 40 in one scene",
            lambda: logits(torch.linspace(-40.0, 40.0, 24)),
        )
    )
    return cases


def _rotations() -> list[Case]:
    scene = ordinary_scene(camera=facing_camera())
    unit = np.asarray(scene.quats / scene.quats.norm(dim=1, keepdim=True))
    cases = [
        _rendered(
            f"quats_{length:g}",
            f"quaternions of length {length:g}",
            partial(scene.with_arrays, quats=unit * length),
            ALL,
        )
        for length in (1e-7, 1e-3, 1e3, 1e20)
    ]
    cases.append(
        _culled("quats_zero", "6 quaternions of zeros", "degenerate", lambda: _with_rows(quats=np.zeros((6, 4))), FIRST)
    )
    return cases


def _determinants() -> list[Case]:
    sharp = RasterSettings(low_pass=1e-3, threads=1)
    cases = [
        _rendered("flat_disc", "one scale 0", lambda: _scaled([1.0, 1.0, 0.0]), ALL),
        _rendered("flat_line", "two scales 0", lambda: _scaled([1.0, 0.0, 0.0]), ALL),
        _rendered("flat_point", "all scales 0", lambda: _scaled([0.0, 0.0, 0.0]), ALL),
    ]
    for factor in (1.0, 1e-2, 1e-4):
        cases.append(
            _rendered(
                f"det_low_pass_{factor:g}",
                f"needles times {factor:g} with the smallest low-pass filter, 0.001",
                partial(replace, _scaled([factor, 1e-4 * factor, 1e-4 * factor]), settings=sharp),
            )
        )
    cases.append(
        _rendered(
            "det_at_least",
            f"scales 0 with low-pass filter 0.001: det = {DET_MIN:g}, the smallest that is rendered",
            lambda: replace(_scaled([0.0] * 3), settings=sharp),
        )
    )
    return cases


def _pictures() -> list[Case]:
    def spread(width: int, height: int) -> Scene:
        longest = max(width, height)
        camera = facing_camera(width, height, focal=0.6 * longest + 1.0)
        half = np.array([0.7 * width / longest, 0.7 * height / longest, 0.4])
        means = np.random.default_rng(0).normal(size=(24, 3)) * half + [0.0, 0.0, 3.0]
        return ordinary_scene(camera=camera).with_arrays(means=means)

    def behind() -> Scene:
        scene = ordinary_scene(camera=facing_camera())
        return scene.with_arrays(means=scene.means * torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64))

    cases = [
        _rendered(f"picture_{w}x{h}", f"a picture of {w}x{h} pixels", partial(spread, w, h))
        for w, h in ((1, 1), (1, 4096), (4097, 3))
    ]
    cases.append(_culled("nothing_visible", "all Gaussians behind the camera", "near", behind, ALL))
    cases.append(_rendered("no_gaussians", "no Gaussians", lambda: ordinary_scene(4).rows(slice(0, 0))))
    return cases


def _thresholds() -> list[Case]:
    def clamped() -> Scene:
        at = np.float32(ALPHA_MAX)
        opacities = at + np.arange(-12, 12) * np.spacing(at)
        # Gaussians are centred on pixels, where alpha equals the opacity.
        x, y = np.meshgrid(np.arange(4, 40, 6) + 0.5, np.arange(4, 30, 7) + 0.5)
        means = np.stack([(x.ravel() - 20.0) * 3.0 / 50.0, (y.ravel() - 15.0) * 3.0 / 50.0, np.full(24, 3.0)], axis=1)
        return ordinary_scene(24, camera=facing_camera()).with_arrays(means=means, opacities=opacities)

    return [
        Case(
            "passes_agree",
            "weights next to each threshold: exactly equal in forward and backward pass",
            "bounded",
            rules.passes_agree,
        ),
        _rendered(
            "transmittance_at_cut_off",
            "two alphas of 0.99 leave a transmittance of exactly 1e-4 for a third Gaussian",
            lambda: rules.stack_on_one_pixel(np.array([0.99, 0.99, 0.5])),
        ),
        _rendered("alpha_at_clamp", "opacities a few float32 steps from 0.99", clamped),
        Case(
            "clamp_gradient",
            "alpha above 0.99: gradient exactly zero in both backends",
            "bounded",
            rules.clamp_has_no_gradient,
        ),
    ]


def _refusals() -> list[Case]:
    cases = [
        Case(
            f"not_finite_{name}",
            f"NaN, inf or -inf in {name}: the error names the array",
            "refused",
            rules.refuses_input(name),
        )
        for name in NAMES
    ]
    return [
        *cases,
        Case("not_finite_camera", "NaN, inf or -inf in the camera", "refused", rules.refuses_bad_camera),
        Case(
            "not_finite_upstream",
            "NaN, inf or -inf in the gradient of the picture",
            "refused",
            rules.refuses_bad_gradient,
        ),
        Case("not_finite_pictures", "NaN, inf or -inf in picture or photo", "refused", loss.refuses_picture),
        Case("huge_photo", "a photo with values outside of [0, 1]", "refused", loss.refuses_huge_photo),
        Case("not_finite_adam", "NaN, inf or -inf in a gradient for Adam", "refused", optimiser.refuses_gradient),
    ]


def _losses() -> list[Case]:
    return [
        Case(name, f"loss: {what}", "bounded", loss.compares_pictures(make))
        for name, (what, make) in loss.PICTURES.items()
    ]


def _optimisers() -> list[Case]:
    same, valley = optimiser.same_gradients, optimiser.valley
    return [
        Case(
            "adam_same_gradients",
            "10,000 steps at 0.01, gradients 1e-12 to 1e6",
            "bounded",
            optimiser.drifts(same, 1e-2),
        ),
        Case(
            "adam_valley",
            "10,000 steps at 0.01 in a quadratic valley with curvatures 1e-6 to 1e6",
            "bounded",
            optimiser.drifts(valley, 1e-2),
        ),
        Case(
            "adam_small_steps", "10,000 steps at 1.6e-6 in the same valley", "bounded", optimiser.drifts(valley, 1.6e-6)
        ),
    ]


CASES: tuple[Case, ...] = (
    Case("ordinary", "24 ordinary Gaussians", "bounded", lambda bounds: measure_scene(ordinary_scene(), bounds)),
    *_needles(),
    *_sizes(),
    *_near_cases(),
    *_positions(),
    *_opacities(),
    *_rotations(),
    *_determinants(),
    *_pictures(),
    *_thresholds(),
    *_refusals(),
    *_losses(),
    *_optimisers(),
)
"""All cases in the order of the table. Cases of another package get a function above and a line here."""
