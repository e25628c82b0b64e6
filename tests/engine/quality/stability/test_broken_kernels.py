"""Defects that are put into a kernel on purpose turn the right rows of the table red; `test_cases` says that without
them all rows are green."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit

from engine.quality.stability.table import run_case, select_cases
from engine.rasterizer import blend_backward, blend_forward, cpu
from engine.training import adam
from engine.training.losses import photometric


def is_green(case: str) -> bool:
    return run_case(select_cases(case)[0]).green


def rebuilt(function: Any, old: str, new: str, **calls: Any) -> Any:
    """Return a kernel compiled again with `old` replaced in its source and other `calls`; nothing is cached on disk."""
    source = inspect.getsource(function.py_func)
    assert source.count(old) >= 1, f"{old!r} is no longer in the kernel: choose another line"
    scope = {**function.py_func.__globals__, **calls}
    code = source[source.index("def ") :].replace(old, new)
    exec(compile(code, "broken kernel", "exec"), scope)
    return njit(nogil=True, error_model="numpy")(scope[function.py_func.__name__])


def scaled(index: int, factor: float) -> Callable[..., int]:
    """Return the backward kernel of the projection with one of its six outputs multiplied by `factor`."""
    original = cpu.project_gaussians_backward

    def run(*arguments: Any) -> int:
        n_bad: int = original(*arguments)  # the whole scene, because the suite has one thread
        arguments[-6 + index][...] *= np.float32(factor)
        return n_bad

    return run


@pytest.mark.parametrize(
    ("index", "case"), [(0, "ordinary"), (1, "ordinary"), (2, "needle_1e4"), (4, "picture_1x4096")]
)
def test_a_gradient_that_is_a_ten_thousandth_too_large_is_found(
    index: int, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpu, "project_gaussians_backward", scaled(index, 1.0001))
    assert not is_green(case)


def test_a_clamp_that_passes_gradients_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = rebuilt(blend_backward.blend_tiles_backward, "raw <= _ALPHA_MAX", "raw <= f4(2.0)")
    monkeypatch.setattr(cpu, "blend_tiles_backward", broken)
    for case in ("clamp_gradient", "opacity_logit_+20"):
        assert not is_green(case), case


def test_another_alpha_threshold_in_the_backward_pass_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    cover = rebuilt(blend_forward.cover, "alpha >= _ALPHA_MIN", "alpha >= splat(f4(1.001 / 255.0))")
    broken = rebuilt(blend_backward.blend_tiles_backward, "cover(", "cover(", cover=cover)
    monkeypatch.setattr(cpu, "blend_tiles_backward", broken)
    assert not is_green("passes_agree")
    assert is_green("nothing_visible")


def test_ellipses_in_float32_are_found_with_distant_needles(monkeypatch: pytest.MonkeyPatch) -> None:
    """A defect that the first run of the suite found: centres of needles far off screen lost four digits in float32."""
    original = cpu.project_gaussians

    def run(*arguments: Any) -> int:
        n_bad: int = original(*arguments)
        roots = arguments[-8]
        assert roots.dtype == np.float64 and roots.shape[1] == 3
        roots[:] = roots.astype(np.float32)
        return n_bad

    monkeypatch.setattr(cpu, "project_gaussians", run)
    assert is_green("ordinary")
    assert not is_green("needle_centre_off")


def test_a_culled_gaussian_with_a_gradient_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    original = cpu.project_gaussians_backward

    def run(*arguments: Any) -> int:
        n_bad: int = original(*arguments)
        arguments[-6][0] = 1e-30
        return n_bad

    monkeypatch.setattr(cpu, "project_gaussians_backward", run)
    for case in ("nothing_visible", "quats_zero"):
        assert not is_green(case), case


def test_a_missing_check_of_the_input_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cpu, "check_finite", lambda name, value: None)
    assert not is_green("not_finite_opacities")


def test_a_loss_without_gradient_at_a_border_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    original = photometric.difference_gradient

    def run(*arguments: Any) -> None:
        original(*arguments)
        arguments[-1][:3] = 0.0

    monkeypatch.setattr(photometric, "difference_gradient", run)
    assert not is_green("loss_noise")


def test_adam_without_its_bias_correction_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adam, "math", SimpleNamespace(sqrt=lambda value: 1.0))
    assert not is_green("adam_same_gradients")
