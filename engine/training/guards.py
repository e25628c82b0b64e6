"""Checks and clamps that keep values finite during training, and counters of how often each took effect.

Some limits are part of the method and are reached in every run (`LIMITS`). All other counts indicate a problem.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
import torch

from ..core.errors import EnvironmentProblem, NumericalError, TrainingError, is_out_of_memory
from ..rasterizer.settings import ALPHA_MIN
from ..scene import Gaussians
from .adam import MAX_REFUSED_STEPS
from .parameters import Parameters

LIMITS = ("scales_at_limit", "opacities_at_limit")
"""Counts of values that were clamped to a limit of the method, once per Gaussian and step. The gradients keep pushing
against such a limit, so these counts are large."""

MIN_SCALE = 1e-5
"""Smallest scale of a Gaussian, per extent."""

MAX_SCALE = 2.0  # chosen on museum_room
"""Largest scale of a Gaussian, per extent."""

MAX_ASPECT = 50.0  # chosen on museum_room
"""Largest ratio of the longest to the shortest scale of a Gaussian."""

MAX_LOGIT = 13.8
"""Largest absolute opacity logit: opacities stay between 1e-6 and 1 - 1e-6."""

MAX_DISTANCE = 100.0
"""Largest distance from the mean camera along an axis, per extent. Farther Gaussians show no parallax, and float32
loses precision there."""

ADVICE = "Lower the learning rates or check the photos and cameras, then run again; the last checkpoint is kept."


def backward(loss: torch.Tensor, guards: Counter[str]) -> bool:
    """Back-propagate `loss`; return False and count the step when the rasterizer refused non-finite gradients.

    Raises
    ------
    NumericalError
        When the loss is not finite, or after 20 refused steps in total.
    """
    if not bool(torch.isfinite(loss)):
        raise NumericalError(f"The training loss is not finite. {ADVICE}")
    try:
        loss.backward()  # type: ignore[no-untyped-call]
    except NumericalError as error:
        _refuse_step(guards, error)
        return False
    return True


def _refuse_step(guards: Counter[str], error: NumericalError) -> None:
    """Count a step without an update; raise `error` when there were 20 before it."""
    guards["refused_steps"] += 1
    if guards["refused_steps"] > MAX_REFUSED_STEPS:
        raise error


def step_finite_rows(parameters: Parameters, update: Callable[[], None], guards: Counter[str]) -> None:
    """Run `update`, but restore the values and moments of Gaussians whose gradient is not finite, and count these.

    Raises
    ------
    NumericalError
        After 20 steps in total in which no Gaussian could be updated.
    """
    broken = _rows_not_finite(parameters)
    if broken is None:
        update()
        return
    if len(broken) == len(parameters):
        _refuse_step(guards, NumericalError(f"No gradient of any Gaussian is finite. {ADVICE}"))
        return
    guards["gaussians_not_updated"] += len(broken)
    values = {name: value.detach()[broken] for name, value in parameters.values.items()}
    moments = {name: (s.mean[broken], s.square[broken]) for name, s in parameters.moments.items()}
    for value in parameters.values.values():
        if value.grad is not None:
            value.grad[broken] = 0.0
    update()
    for name, value in parameters.values.items():
        value.detach()[broken] = values[name]
        parameters.moments[name].mean[broken], parameters.moments[name].square[broken] = moments[name]


def _rows_not_finite(parameters: Parameters) -> torch.Tensor | None:
    """Return the rows with a gradient whose square, which Adam accumulates, is not finite; None when there are none."""
    grads = [value.grad for value in parameters.values.values() if value.grad is not None]
    # A float32 sum of squares is finite only if all squares are, so one pass suffices in the usual case.
    if math.isfinite(sum(float(torch.linalg.vector_norm(grad)) for grad in grads)):
        return None
    broken = torch.zeros(len(parameters), dtype=torch.bool)
    for grad in grads:
        broken |= ~torch.isfinite(grad.square()).reshape(len(grad), -1).all(dim=1)
    rows = broken.nonzero()[:, 0]
    return rows if len(rows) else None


def clamp_parameters(parameters: Parameters, center: torch.Tensor, extent: float, guards: Counter[str]) -> None:
    """Clamp scales, aspect, opacities and positions to ranges where float32 is precise; count the clamped Gaussians.

    Parameters
    ----------
    parameters : Parameters
        Changed in place.
    center : tensor of shape [3]
        Mean camera position.
    extent : float
        Extent of the scene, world units.
    guards : Counter
        Counts ``scales_at_limit``, ``opacities_at_limit``, ``clamped_positions``, ``reset_rotations``.
    """
    log_scales = parameters.values["log_scales"].detach()[parameters.n_background :]
    longest = log_scales.amax(dim=1, keepdim=True).clamp_max(math.log(MAX_SCALE * extent))
    shortest = (longest - math.log(MAX_ASPECT)).clamp_min(math.log(MIN_SCALE * extent))
    clamped = torch.minimum(torch.maximum(log_scales, shortest), torch.maximum(longest, shortest))
    guards["scales_at_limit"] += int((clamped != log_scales).any(dim=1).sum())
    log_scales.copy_(clamped)

    logits = parameters.values["opacity_logits"].detach()
    guards["opacities_at_limit"] += int((logits.abs() > MAX_LOGIT).sum())
    logits.clamp_(-MAX_LOGIT, MAX_LOGIT)

    means = parameters.values["means"].detach()
    limit = MAX_DISTANCE * extent
    far = ((means - center).abs() > limit).any(dim=1)
    if bool(far.any()):
        guards["clamped_positions"] += int(far.sum())
        means[far] = center + (means[far] - center).clamp(-limit, limit)

    quats = parameters.values["quats"].detach()
    norms = quats.norm(dim=1, keepdim=True)
    degenerate = norms[:, 0] < 1e-6
    if bool(degenerate.any()):
        guards["reset_rotations"] += int(degenerate.sum())
        quats[degenerate] = torch.tensor([1.0, 0.0, 0.0, 0.0])
        norms = quats.norm(dim=1, keepdim=True)
    quats.div_(norms)


def check_start(start: Gaussians) -> None:
    """Refuse initial Gaussians that are empty or not finite.

    Raises
    ------
    TrainingError, NumericalError
    """
    if len(start) == 0:
        raise TrainingError("There are no Gaussians to start from. Take more photos that overlap, then run again.")
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh", "features"):
        values = getattr(start, name)
        if values is not None and (n_bad := int((~np.isfinite(values).reshape(len(start), -1).all(axis=1)).sum())):
            raise NumericalError(
                f"`{name}` of {n_bad} of the {len(start)} Gaussians to start from is not finite. "
                "Check the sparse points and cameras that were given, then run again."
            )


def check_result(parameters: Parameters, *, photos_are_black: bool) -> None:
    """Refuse a result that is not finite or not visible.

    Raises
    ------
    NumericalError
        When a value of a Gaussian is not finite.
    TrainingError
        When all Gaussians are transparent, unless the photos are black.
    """
    for name, value in parameters.values.items():
        if not bool(torch.isfinite(value).all()):
            raise NumericalError(f"`{name}` is not finite after training. {ADVICE}")
    # Below ALPHA_MIN they are not rendered and have no gradient, so training cannot recover them.
    if not photos_are_black and bool((parameters.values["opacity_logits"].sigmoid() < ALPHA_MIN).all()):
        raise TrainingError(f"Training lost the scene: all {len(parameters)} Gaussians became transparent. {ADVICE}")


@contextlib.contextmanager
def translate_out_of_memory() -> Iterator[None]:
    """Translate the out-of-memory error of any library into one sentence.

    Raises
    ------
    EnvironmentProblem
    """
    try:
        yield
    except Exception as error:
        if not is_out_of_memory(error):
            raise
        raise EnvironmentProblem(
            "The memory of this machine is full. Close other programs and run again, which continues from the last "
            "checkpoint, or choose a smaller preset or fewer photos."
        ) from error
