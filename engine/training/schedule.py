"""What happens when: the plan of a training run as pure functions of the step, which is why a resumed run is exact."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from .settings import TrainingSettings

__all__ = ["Schedule"]

_WORK_BESIDE_PIXELS = 0.25
"""Share of a full-size step that does not depend on the picture's size: projection, Adam. For the time left only."""

_FLAT_CHECKS = 40
"""Looks at the held-out error in as many steps as there are, of which those after growth has ended are taken: each
costs as much as 3 steps, one in 75 in `standard`."""

_LARGEST_FACTOR = 1.3
"""Of one growth: those just split must settle before their error says where the next are needed."""


class Schedule:
    """The plan of one run.

    Parameters
    ----------
    settings : TrainingSettings
    n_views : int
        Photos that are trained on.
    extent : float
        Of the scene, world units.
    labelled : sequence of int
        Numbers of those with segments.
    """

    def __init__(
        self, settings: TrainingSettings, n_views: int, extent: float, *, labelled: Sequence[int] = ()
    ) -> None:
        self._settings = settings
        self._n_views = n_views
        self._labelled = labelled
        self._extent = extent
        per_step = [_WORK_BESIDE_PIXELS + 0.25 ** self.halvings(step) for step in range(settings.steps)]
        self._work = np.concatenate([[0.0], np.cumsum(per_step)])
        self.flat_checks = _flat_checks(settings)
        self.curve_steps = _log_spaced(settings.steps, settings.curve_points) | self.flat_checks

    def view(self, step: int) -> int:
        """Which training view the step uses: every one once per round, in a new random order each round.

        Where only some have segments, the steps that evaluate L_CC go round among those.
        """
        interval = self._settings.clustering_interval
        if not 0 < len(self._labelled) < self._n_views:
            return self._place_in_round(step, self._n_views, 0)
        if step % interval == 0:
            return self._labelled[self._place_in_round(step // interval, len(self._labelled), 1)]
        return self._place_in_round(step - step // interval - 1, self._n_views, 0)

    def _place_in_round(self, index: int, n: int, kind: int) -> int:
        round_number, place = divmod(index, n)
        return int(np.random.default_rng((self._settings.seed, kind, round_number)).permutation(n)[place])

    def halvings(self, step: int) -> int:
        """How often the pictures are halved at the step."""
        levels, until = self._settings.coarse_levels, self._settings.coarse_until * self._settings.steps
        return levels - int(levels * step / until) if levels and step < until else 0

    def sh_degree(self, step: int) -> int:
        """Highest band of spherical harmonics at the step."""
        return min(self._settings.sh_degree, step // self._settings.sh_interval)

    def generator(self, step: int, purpose: int) -> torch.Generator:
        """Return a fresh random generator for one `purpose` at one step."""
        state = np.random.SeedSequence((self._settings.seed, step, purpose)).generate_state(1, np.uint64)[0]
        return torch.Generator().manual_seed(int(state >> np.uint64(1)))

    def learning_rates(self, step: int) -> dict[str, float]:
        """Return the rate of every parameter at the step."""
        s = self._settings
        t = step / max(s.steps - 1, 1)
        decay = s.lr_end ** max(0.0, 2.0 * t - 1.0)
        return {
            "means": self.means_rate(step) * self._extent,
            "log_scales": s.lr_scales * decay,
            "quats": s.lr_quats * decay,
            "opacity_logits": s.lr_opacity * decay,
            "sh_dc": s.lr_sh * decay,
            "sh_rest": s.lr_sh_rest * decay,
            "features": s.lr_features * decay,
        }

    def means_rate(self, step: int) -> float:
        """Return the rate of the positions per extent at the step."""
        t = step / max(self._settings.steps - 1, 1)
        return float(self._settings.lr_means ** (1 - t) * self._settings.lr_means_end**t)

    def grows(self, step: int) -> bool:
        """Whether Gaussians are relocated and added after the step."""
        s = self._settings
        return step > 0 and step % s.grow_interval == 0 and s.grow_from * s.steps <= step < s.grow_until * s.steps

    def gaussians_after_growth(self, step: int, n: int) -> int:
        """Return how many Gaussians `n` become when they grow at the step."""
        s = self._settings
        factor = s.grow_factor
        if s.growth == "error":
            half_way = (s.grow_from + s.grow_until) / 2 * s.steps
            growths_left = max(1.0, (half_way - step) / s.grow_interval)
            factor = min(_LARGEST_FACTOR, max(factor, (s.max_gaussians / n) ** (1.0 / growths_left)))
        return max(n, min(s.max_gaussians, max(n + 1, int(n * factor))))

    def growth_ended(self, step: int) -> bool:
        """Whether no Gaussian is relocated or added any more."""
        return step >= self._settings.grow_until * self._settings.steps

    def done(self, step: int) -> float:
        """Return the share of the whole work done before the step, 0 to 1."""
        return float(self._work[step] / self._work[-1])


def _flat_checks(settings: TrainingSettings) -> frozenset[int]:
    """Return the numbers of finished steps after which it is asked whether more are worth it."""
    if settings.stop_when_flat == 0:
        return frozenset()
    first = math.ceil(settings.grow_until * settings.steps)
    return frozenset(range(first, settings.steps, max(1, settings.steps // _FLAT_CHECKS)))


def _log_spaced(steps: int, n: int) -> frozenset[int]:
    """Return up to `n` numbers of finished steps, evenly spaced in the logarithm, the last one `steps`."""
    first = min(steps, max(10, steps // 64))
    return frozenset(int(round(value)) for value in np.geomspace(steps, first, n))
