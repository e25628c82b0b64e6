"""What keeps values finite while training, and the counts of how often it had to.

Some limits are part of the method and met in every run (`LIMITS`); all other counts are signs of trouble.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
import torch

from ..errors import EnvironmentProblem, NumericalError, TrainingError, is_out_of_memory
from ..rasterizer.settings import ALPHA_MIN
from ..scene import Gaussians
from .parameters import Parameters

__all__ = [
    "ADVICE",
    "LIMITS",
    "backward",
    "check_result",
    "check_start",
    "clamp_parameters",
    "step_finite_rows",
    "translate_out_of_memory",
]

LIMITS = ("scales_at_limit", "opacities_at_limit")
"""Counts of values kept at a limit of the method, once per Gaussian and step. Training goes on pushing against it."""


_SMALLEST_SCALE = 1e-5
"""Per extent."""
_LARGEST_SCALE = 2.0
_LARGEST_ASPECT = 50.0
_LARGEST_LOGIT = 13.8
"""Opacity stays between 1e-6 and 1 - 1e-6."""
_FARTHEST = 100.0
"""Per extent, from the mean camera: what lies beyond shows no parallax and costs float32 its digits."""
_MOST_FAILED_STEPS = 20

ADVICE = "Lower the learning rates or check the photos and cameras, then run again; the last checkpoint is kept."


def backward(loss: torch.Tensor, guards: Counter[str]) -> bool:
    """Back-propagate `loss`; return False (and count it) when the rasterizer refused gradients that are not finite.

    Raises
    ------
    NumericalError
        When the loss is not finite, or after 20 refused steps in all.
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
    """Count a step that changes nothing; raise `error` when there were 20 before it."""
    guards["refused_steps"] += 1
    if guards["refused_steps"] > _MOST_FAILED_STEPS:
        raise error


def step_finite_rows(parameters: Parameters, update: Callable[[], None], guards: Counter[str]) -> None:
    """Run `update`, but leave each Gaussian as it is, moments included, whose gradient is not finite; count those.

    Raises
    ------
    NumericalError
        After 20 steps in all in which no Gaussian could be updated.
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
    """Return the rows with a gradient whose square is not finite, None when there are none: Adam keeps squares."""
    grads = [value.grad for value in parameters.values.values() if value.grad is not None]
    # A float32 sum of squares is finite only if all of them are: one pass in the usual case.
    if math.isfinite(sum(float(torch.linalg.vector_norm(grad)) for grad in grads)):
        return None
    broken = torch.zeros(len(parameters), dtype=torch.bool)
    for grad in grads:
        broken |= ~torch.isfinite(grad.square()).reshape(len(grad), -1).all(dim=1)
    rows = broken.nonzero()[:, 0]
    return rows if len(rows) else None


def clamp_parameters(parameters: Parameters, center: torch.Tensor, extent: float, guards: Counter[str]) -> None:
    """Clamp scales, aspect (1:50), opacities and positions to where float32 works; count the Gaussians concerned.

    Parameters
    ----------
    parameters : Parameters
        Changed in place.
    center : tensor of shape [3]
        Mean camera position.
    extent : float
        Of the scene, world units.
    guards : Counter
        Gets ``scales_at_limit``, ``opacities_at_limit``, ``clamped_positions``, ``reset_rotations``.
    """
    log_scales = parameters.values["log_scales"].detach()
    longest = log_scales.amax(dim=1, keepdim=True).clamp_max(math.log(_LARGEST_SCALE * extent))
    shortest = (longest - math.log(_LARGEST_ASPECT)).clamp_min(math.log(_SMALLEST_SCALE * extent))
    held = torch.minimum(torch.maximum(log_scales, shortest), torch.maximum(longest, shortest))
    guards["scales_at_limit"] += int((held != log_scales).any(dim=1).sum())
    log_scales.copy_(held)

    logits = parameters.values["opacity_logits"].detach()
    guards["opacities_at_limit"] += int((logits.abs() > _LARGEST_LOGIT).sum())
    logits.clamp_(-_LARGEST_LOGIT, _LARGEST_LOGIT)

    means = parameters.values["means"].detach()
    limit = _FARTHEST * extent
    far = ((means - center).abs() > limit).any(dim=1)
    if bool(far.any()):
        guards["clamped_positions"] += int(far.sum())
        means[far] = center + (means[far] - center).clamp(-limit, limit)

    quats = parameters.values["quats"].detach()
    norms = quats.norm(dim=1, keepdim=True)
    lost = norms[:, 0] < 1e-6
    if bool(lost.any()):
        guards["reset_rotations"] += int(lost.sum())
        quats[lost] = torch.tensor([1.0, 0.0, 0.0, 0.0])
        norms = quats.norm(dim=1, keepdim=True)
    quats.div_(norms)


def check_start(start: Gaussians) -> None:
    """Refuse Gaussians to start from that are none, or not finite.

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
    """Refuse a result that is not finite, or of which nothing can be seen.

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
    # Below this they are not drawn and have no gradient: training cannot bring them back.
    if not photos_are_black and bool((parameters.values["opacity_logits"].sigmoid() < ALPHA_MIN).all()):
        raise TrainingError(f"Training lost the scene: all {len(parameters)} Gaussians became transparent. {ADVICE}")


@contextlib.contextmanager
def translate_out_of_memory() -> Iterator[None]:
    """Turn every library's way of running out of memory into one sentence.

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
