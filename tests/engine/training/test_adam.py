"""Adam gives the steps of `torch.optim.Adam`."""

from __future__ import annotations

import pytest
import torch

from engine.core.errors import NumericalError
from engine.training.adam import AdamState, adam_step


def test_steps_agree_with_torch_for_several_parameters_and_rates() -> None:
    generator = torch.Generator().manual_seed(0)
    ours = [torch.randn(1000, 3, generator=generator), torch.randn(70, 16, 3, generator=generator)]
    theirs = [parameter.double().requires_grad_() for parameter in ours]
    rates = (1e-2, 1e-3)
    optimizer = torch.optim.Adam([{"params": [p], "lr": r} for p, r in zip(theirs, rates, strict=True)], eps=1e-15)
    states = [AdamState.zeros_like(parameter) for parameter in ours]
    for _ in range(30):
        gradients = [torch.randn(parameter.shape, generator=generator) for parameter in ours]
        for parameter, gradient in zip(theirs, gradients, strict=True):
            parameter.grad = gradient.double()
        optimizer.step()
        adam_step(list(zip(ours, gradients, rates, strict=True)), states)
    for parameter, expected in zip(ours, theirs, strict=True):
        torch.testing.assert_close(parameter.double(), expected.detach(), rtol=1e-5, atol=2e-6)


def test_a_value_without_moments_late_in_a_run_changes_by_its_rate_and_no_more() -> None:
    changes = []
    for limits in ({}, {"largest": 1.0}):
        parameter = torch.zeros(1, 3)
        state = AdamState(torch.zeros(1, 3), torch.zeros(1, 3), step=2000)
        adam_step([(parameter, torch.tensor([[1.0, -2.0, 0.0]]), 0.1)], [state], **limits)
        changes.append(parameter[0].tolist())
    # The first step of a fresh Gaussian: 0.1 / sqrt(0.001) of the rate, corrected for 2,000 steps.
    assert changes[0] == pytest.approx([-0.294, 0.294, 0.0], abs=1e-3)
    assert changes[1] == pytest.approx([-0.1, 0.1, 0.0])


def test_steps_are_the_same_bit_for_bit_with_any_number_of_threads() -> None:
    start, gradient = torch.randn(501, 3), torch.randn(501, 3)
    found = []
    for threads in (1, 4):
        parameter, state = start.clone(), AdamState.zeros_like(start)
        for _ in range(3):
            adam_step([(parameter, gradient, 0.1)], [state], threads=threads)
        found.append(parameter)
    assert torch.equal(*found)


def test_a_gradient_that_is_not_finite_is_refused_and_nothing_changes() -> None:
    parameter, gradient = torch.ones(5, 3), torch.ones(5, 3)
    gradient[2, 1] = float("nan")
    state = AdamState.zeros_like(parameter)
    with pytest.raises(NumericalError, match="not finite in 1 values"):
        adam_step([(parameter, gradient, 0.1)], [state])
    assert bool((parameter == 1).all()) and state.step == 0 and not state.mean.any()
