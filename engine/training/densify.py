"""Densification with a fixed budget of Gaussians: relocation of dead ones, copies and halves of others, a random walk.

Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo" (NeurIPS), implemented from the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch

from ..rasterizer import rotation_matrices
from ..rasterizer.settings import Backend
from .parameters import Parameters, render
from .population import Population
from .start import EmptySpace, StartPoints
from .views import Level

MAX_COPIES = 51  # Kheradmand et al. 2024
"""Largest number of coincident copies; more are treated as this many. `copy_correction` is accurate up to it."""

_MIN_OPACITY = 0.005  # Kheradmand et al. 2024
"""Gaussians of at most this opacity are relocated."""

OPACITY_MARGIN = 1e-6
"""Opacities are clamped to this distance from 0 and 1 before their logit is taken."""

SPLIT_SHIFT = 0.7  # chosen on museum_room
"""Distance of the halves of a split Gaussian from its centre, in its longest scale."""

MAX_RAISED_OPACITY = 0.999
"""Largest opacity that `drop` gives to the Gaussians that are left."""

MAX_WALK = 3.0  # chosen on stability_scenes
"""Largest distance that noise moves a Gaussian in one step, in its own scales. At our learning rates, ten times the
published ones, a large Gaussian would otherwise leave the scene in a single step."""


def copy_correction(
    opacities: torch.Tensor, scales: torch.Tensor, n_copies: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the opacity and scales of each of n coincident copies that look like the Gaussian they replace.

    Parameters
    ----------
    opacities : tensor of shape [M]
        Opacity of the Gaussian, in (0, 1).
    scales : tensor of shape [M, 3]
        Linear scales of the Gaussian.
    n_copies : int tensor of shape [M]
        1 to 51; more are treated as 51.

    Returns
    -------
    opacities : tensor of shape [M]
        ``o' = 1 - (1 - o)^(1/n)``
    scales : tensor of shape [M, 3]
        ``s' = s o / sum_{i=1..n} sum_{k=0..i-1} C(i-1, k) (-1)^k o'^(k+1) / sqrt(k+1)``

    Notes
    -----
    Equation 9 of the paper. The double sum alternates; in float64 it agrees with exact arithmetic to 1e-6 for n <= 51
    and o from 0.006 to 0.99 (tested).
    """
    n = n_copies.clamp(1, MAX_COPIES)
    o = opacities.double()
    new = -torch.expm1(torch.log1p(-o) / n)
    # sum_{i=1..n} C(i-1, k) = C(n, k+1): the double sum is a single one.
    total = torch.zeros_like(o)
    for k in range(int(n.max()) if len(n) else 0):
        binomial = _BINOMIALS[n, k + 1]
        total += binomial * (-1) ** k * new ** (k + 1) / math.sqrt(k + 1)
    return new.to(opacities.dtype), (scales.double() * (o / total)[:, None]).to(scales.dtype)


_BINOMIALS = torch.tensor(
    [[float(math.comb(n, k)) for k in range(MAX_COPIES + 1)] for n in range(MAX_COPIES + 1)], dtype=torch.float64
)


def relocate(
    parameters: Parameters | Population,
    *,
    empty_space: EmptySpace | None = None,
    generator: torch.Generator,
) -> int:
    """Move each Gaussian of at most `_MIN_OPACITY`, or in `empty_space`, onto another one, drawn by opacity.

    Return how many moved. Without those in empty space, the picture stays the same to first order (`copy_correction`).
    Nothing is moved when no other Gaussian is left.
    """
    opacities = parameters.values["opacity_logits"].detach().sigmoid()
    moves = opacities <= _MIN_OPACITY
    if empty_space is not None:
        moves |= empty_space.holds(parameters.values["means"].detach())
    stays = ~moves
    moves[: parameters.n_background] = stays[: parameters.n_background] = False
    moved, alive = moves.nonzero()[:, 0], stays.nonzero()[:, 0]
    if len(moved) == 0 or len(alive) == 0:
        return 0
    chosen = alive[_draw(opacities[alive], len(moved), generator)]
    _share_between_copies(parameters, chosen)
    parameters.overwrite(moved, parameters.copies(chosen))
    return len(moved)


def grow(parameters: Parameters | Population, weights: torch.Tensor, n_new: int, *, generator: torch.Generator) -> None:
    """Add `n_new` copies of Gaussians drawn by `weights`, with replacement; the picture stays the same to first order.

    Parameters
    ----------
    parameters : Parameters or Population
        Changed in place.
    weights : tensor of shape [N]
        Opacities, or the result of `mixed_weights`. Those of the background count as 0.
    """
    weights = weights.clone()
    weights[: parameters.n_background] = 0.0
    if n_new <= 0 or not bool((weights > 0).any()):
        return
    chosen = _draw(weights, n_new, generator)
    _share_between_copies(parameters, chosen)
    parameters.append(parameters.copies(chosen))


def grow_by_error(
    parameters: Parameters | Population,
    errors: torch.Tensor,
    n_new: int,
    start_points: StartPoints,
    *,
    generator: torch.Generator,
) -> None:
    """Add `n_new` Gaussians, drawn half by `errors` and half by opacity: half of them by `split`, half by `grow`.

    Only Gaussians near initial points are split. Farther away, the halves fit what a single photo shows.

    Parameters
    ----------
    parameters : Parameters or Population
        Changed in place.
    errors : tensor of shape [N]
        See `gaussian_errors`.
    """
    values = parameters.values
    weights = mixed_weights(errors, values["opacity_logits"].detach().sigmoid())
    means = values["means"].detach()
    n_split = split(
        parameters, weights, n_new // 2, allowed=lambda rows: start_points.near(means[rows]), generator=generator
    )
    # The halves that were added are not copied in the same step.
    grow(parameters, torch.cat([weights, torch.zeros(n_split)]), n_new - n_split, generator=generator)


def split(
    parameters: Parameters | Population,
    weights: torch.Tensor,
    n_new: int,
    *,
    generator: torch.Generator,
    allowed: Callable[[torch.Tensor], torch.Tensor] | None = None,
) -> int:
    """Split `n_new` Gaussians drawn by `weights`, without replacement, into two; return how many were split.

    Parameters
    ----------
    parameters : Parameters or Population
        Changed in place: one half takes the place of the Gaussian, the other is appended.
    weights : tensor of shape [N]
        Those of the background count as 0.
    allowed : callable, optional
        Returns which of the given rows may be split; all by default.

    Notes
    -----
    A Gaussian of longest scale s becomes two at +-0.7 s along that axis, of scale sqrt(1 - 0.7^2) s and opacity
    o / (2 sqrt(1 - 0.7^2)). Position, covariance and mass of the pair equal those of the Gaussian. Copies at the same
    place get the same gradients and need hundreds of steps to separate; halves show detail at once.
    """
    weights = weights.clone()
    weights[: parameters.n_background] = 0.0
    rows = _draw_distinct(weights, n_new, generator, allowed)
    if len(rows) == 0:
        return 0
    whole = parameters.copies(rows)
    longest, index = whole["log_scales"].argmax(dim=1), torch.arange(len(rows))
    axis = rotation_matrices(whole["quats"])[index, :, longest]
    shift = axis * (SPLIT_SHIFT * whole["log_scales"][index, longest].exp())[:, None]
    narrower = math.sqrt(1.0 - SPLIT_SHIFT**2)
    log_scales = whole["log_scales"].clone()
    log_scales[index, longest] += math.log(narrower)
    logits = (whole["opacity_logits"].sigmoid() / (2.0 * narrower)).logit(OPACITY_MARGIN)
    half = {**whole, "log_scales": log_scales, "opacity_logits": logits}
    parameters.overwrite(rows, {**half, "means": half["means"] - shift})
    parameters.append({**half, "means": half["means"] + shift})
    return len(rows)


def drop(opacities: torch.Tensor, fraction: float, *, n_background: int, generator: torch.Generator) -> torch.Tensor:
    """Return opacities for one picture in which a random `fraction` of the Gaussians is left out, shape [N].

    A Gaussian that hides behind others, where a single photo puts it, then becomes visible in other photos and is
    corrected by them. Park et al. 2025, "DropGaussian" (CVPR), implemented from the formulas.

    Parameters
    ----------
    opacities : tensor of shape [N]
    fraction : float
        From 0, for none, to below 1.
    n_background : int
        The first so many Gaussians stay as they are.

    Notes
    -----
    ``o / (1 - fraction)`` for those that stay and 0 for the others, so that the expected opacity is o.
    """
    left = (torch.rand(len(opacities), generator=generator) >= fraction) / (1.0 - fraction)
    left[:n_background] = 1.0
    return (opacities * left).clamp_max(MAX_RAISED_OPACITY)


def gaussian_errors(
    parameters: Parameters, levels: Sequence[Level], *, backend: Backend, sh_degree: int
) -> torch.Tensor:
    """Return the error of the rendered pictures in the pixels that each Gaussian covers, shape [N].

    ``v_g = sum over pixels of w_g |image - photo|`` with w_g the blending weight. A picture is linear in its channels,
    so this is the gradient of the error, weighted by an additional channel, with respect to that channel.
    """
    values = {name: value.detach() for name, value in parameters.values.items()}
    channel = torch.zeros(len(parameters), 1, requires_grad=True)
    with torch.enable_grad():
        for level in levels:
            raster = render(values, level.camera, backend=backend, sh_degree=sh_degree, channels=channel)
            photo = torch.from_numpy(level.pixels).float().div_(255.0)
            error = (raster.image[..., :3].detach() - photo).abs().mean(dim=2)
            if level.valid is not None:
                error[torch.from_numpy(~level.valid)] = 0.0
            (raster.image[..., 3] * error).sum().backward()  # type: ignore[no-untyped-call]
    assert channel.grad is not None
    return channel.grad[:, 0]


def mixed_weights(errors: torch.Tensor, opacities: torch.Tensor) -> torch.Tensor:
    """Return the mean of `errors` and `opacities`, each divided by its sum, shape [N].

    Errors alone put all Gaussians where single photos are not explained, which overfits few photos; opacities alone
    miss detail. See docs/training.md.
    """
    by_error, by_opacity = (part / part.sum().clamp_min(1e-30) for part in (errors.clamp_min(0.0), opacities))
    return 0.5 * (by_error + by_opacity)


def _draw(weights: torch.Tensor, n: int, generator: torch.Generator) -> torch.Tensor:
    """Return `n` indices drawn with replacement by `weights`; `torch.multinomial` refuses 2^24 rows and more."""
    edges = weights.double().cumsum(0)
    points = torch.rand(n, dtype=torch.float64, generator=generator) * edges[-1]
    return torch.searchsorted(edges, points, right=True).clamp_max(len(weights) - 1)


def _draw_distinct(
    weights: torch.Tensor,
    n: int,
    generator: torch.Generator,
    allowed: Callable[[torch.Tensor], torch.Tensor] | None,
) -> torch.Tensor:
    """Return up to `n` distinct rows drawn by `weights` of those that are `allowed`."""
    n_possible = int((weights > 0).sum())
    if n <= 0 or n_possible == 0:
        return torch.zeros(0, dtype=torch.int64)
    # The n smallest of E / w, with E exponentially distributed, are a draw without replacement by w.
    race = -torch.rand(len(weights), dtype=torch.float64, generator=generator).clamp_min(1e-300).log()
    race = race / weights.double()
    n_asked, kept = 0, torch.zeros(0, dtype=torch.int64)
    while len(kept) < n and n_asked < n_possible:
        # Few rows are asked about, because the answer can take long.
        n_before, n_asked = n_asked, min(max(n, 2 * n_asked), n_possible)
        rows = race.topk(n_asked, largest=False).indices[n_before:]
        kept = torch.cat([kept, rows if allowed is None else rows[allowed(rows)]])
    return kept[:n]


def _share_between_copies(parameters: Parameters | Population, chosen: torch.Tensor) -> None:
    """Give each distinct Gaussian in `chosen` the opacity and scales of one of its copies; it counts as one of them."""
    rows, times = chosen.unique(return_counts=True)
    opacities, scales = copy_correction(
        parameters.values["opacity_logits"].detach()[rows].sigmoid().clamp(OPACITY_MARGIN, 1 - OPACITY_MARGIN),
        parameters.values["log_scales"].detach()[rows].exp(),
        times + 1,
    )
    new = {"opacity_logits": opacities.logit(OPACITY_MARGIN), "log_scales": scales.log()}
    parameters.overwrite(rows, new)


def position_noise(
    parameters: Parameters, *, learning_rate: float, extent: float, strength: float, generator: torch.Generator
) -> None:
    """Move the centres of nearly transparent Gaussians at random, along and within their own shape.

    Parameters
    ----------
    parameters : Parameters
        Changed in place.
    learning_rate : float
        Learning rate of the positions, per extent.
    extent : float
        Extent of the scene, world units. It makes the walk independent of the unit.
    strength : float
        Factor of the noise, 5e5 in the paper.

    Notes
    -----
    ``means += lr strength s(100 (0.005 - o)) (Sigma / extent) eta`` with eta ~ N(0, I) and s the logistic function, so
    that solid Gaussians do not move. Along an axis of scale a, ``lr strength s() a^2 / extent`` is limited to 3 a.
    """
    values = {name: value.detach() for name, value in parameters.values.items()}
    opacities = values["opacity_logits"].sigmoid()
    # Above opacity 0.2 the factor is below 4e-9. Most rows are, and they are left out.
    rows = (opacities < 0.2).nonzero()[:, 0]
    eta = torch.randn(len(rows), 3, generator=generator)
    amount = learning_rate * strength / extent * torch.sigmoid(100.0 * (0.005 - opacities[rows]))
    rotation = rotation_matrices(values["quats"][rows])
    scales = values["log_scales"][rows].exp()
    local = scales * (amount[:, None] * scales).clamp_max(MAX_WALK)
    local = local * (rotation.transpose(1, 2) @ eta[:, :, None])[:, :, 0]
    values["means"][rows] += (rotation @ local[:, :, None])[:, :, 0]
