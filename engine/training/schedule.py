"""What happens when: the plan of a training run as pure functions of the step, which is why a resumed run is exact."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from .settings import TrainingSettings
from .spectrum import TYPICAL_SHARES
from .trials import EXPOSURE

__all__ = ["Schedule"]

_WORK_BESIDE_PIXELS = 0.25
"""Share of a full-size step that does not depend on the picture's size: projection, Adam. For the time left only."""

_FLAT_CHECKS = 40
"""Looks at the held-out error in as many steps as there are, of which those at full size before the cooldown are taken:
each costs as much as 3 steps, one in 75 in `standard`."""

_TRANSIENT_SEARCHES = (0.2, 0.4)
"""Parts of the steps after which it is looked for what stands in one photo only. Each look replaces what the one before
found: what the Gaussians have learned of somebody who walks by is forgotten once he is left out."""

_EXPOSURE_TRIAL = 0.25
"""Part of the steps after which the brightness factors are tried: the scene's colours are known, its detail is not."""

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
    shares : sequence of float
        How much of the photos' detail smaller pictures show, see `spectrum.coarse_shares`.
    """

    def __init__(
        self,
        settings: TrainingSettings,
        n_views: int,
        extent: float,
        *,
        labelled: Sequence[int] = (),
        shares: Sequence[float] = TYPICAL_SHARES,
    ) -> None:
        self._settings = settings
        self._n_views = n_views
        self._labelled = labelled
        self._extent = extent
        coarse = settings.coarse_until * settings.steps
        self._coarse_ends = [coarse * share for share in shares[1 : 2 * settings.coarse_levels + 1]]
        self._cooling_steps = round(settings.cooldown * settings.steps)
        per_step = [_WORK_BESIDE_PIXELS + self.scale(step) ** 2 for step in range(settings.steps)]
        self._work = np.concatenate([[0.0], np.cumsum(per_step)])
        looks = _TRANSIENT_SEARCHES if settings.passers_by else ()
        self.searches_for_transients = frozenset(max(1, round(part * settings.steps)) for part in looks)
        self.flat_checks = _flat_checks(settings, self.cooling_start(None))
        self.trial_steps = settings.trial_steps(n_views)
        self.trials = _trials(settings, self.trial_steps, self.cooling_start(None)) if self.trial_steps else {}
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

    def shrinks(self, step: int) -> int:
        """How often the pictures are made smaller by sqrt(2) at the step.

        DashGaussian's idea (Chen et al. 2025), from the idea: a picture of a given size is trained on for as large a
        part of the coarse steps as the share of the photos' detail that it adds to those still smaller.
        """
        return sum(step < end for end in self._coarse_ends)

    def scale(self, step: int) -> float:
        """Return the pictures' size at the step, 1 for full size."""
        return float(2.0 ** (-self.shrinks(step) / 2))

    def sh_degree(self, step: int, limit: int | None = None) -> int:
        """Return the highest band of spherical harmonics at the step; never above `limit`, which trials set."""
        degree = min(self._settings.sh_degree, step // self._settings.sh_interval)
        return degree if limit is None else min(degree, limit)

    def generator(self, step: int, purpose: int) -> torch.Generator:
        """Return a fresh random generator for one `purpose` at one step."""
        state = np.random.SeedSequence((self._settings.seed, step, purpose)).generate_state(1, np.uint64)[0]
        return torch.Generator().manual_seed(int(state >> np.uint64(1)))

    def cooling_start(self, cooling_from: int | None) -> int:
        """Return the step at which the cooldown begins: `cooling_from`, or so late that it ends with the last step."""
        return self._settings.steps - self._cooling_steps if cooling_from is None else cooling_from

    def last_step(self, cooling_from: int | None) -> int:
        """Return the number of steps after which training ends."""
        return min(self._settings.steps, self.cooling_start(cooling_from) + self._cooling_steps)

    def of_trial(self) -> Schedule:
        """Return the same plan with a cooldown that takes the steps of a trial, and higher bands as fast as band 0.

        At their own rate they settle in a thousand steps: in a trial of 84, band 1 gained 0.004 dB in a room where a
        whole run with it ended 0.25 dB higher.
        """
        other = copy.copy(self)
        other._cooling_steps = self.trial_steps
        other._settings = replace(self._settings, lr_sh_rest=self._settings.lr_sh)
        return other

    def _cooled(self, step: int, cooling_from: int | None) -> float:
        done = step - self.cooling_start(cooling_from)
        return float(self._settings.cooldown_end ** (done / self._cooling_steps)) if done > 0 else 1.0

    def learning_rates(self, step: int, cooling_from: int | None = None) -> dict[str, float]:
        """Return the rate of every parameter at the step.

        Parameters
        ----------
        step : int
        cooling_from : int, optional
            Step at which the cooldown began because the curve was flat.
        """
        s = self._settings
        t = step / max(s.steps - 1, 1)
        decay = s.lr_end ** max(0.0, 2.0 * t - 1.0) * self._cooled(step, cooling_from)
        return {
            "means": self.means_rate(step, cooling_from) * self._extent,
            "log_scales": s.lr_scales * decay,
            "quats": s.lr_quats * decay,
            "opacity_logits": s.lr_opacity * decay,
            "sh_dc": s.lr_sh * decay,
            "sh_rest": s.lr_sh_rest * decay,
            "features": s.lr_features * decay,
        }

    def means_rate(self, step: int, cooling_from: int | None = None) -> float:
        """Return the rate of the positions per extent at the step."""
        t = step / max(self._settings.steps - 1, 1)
        rate = self._settings.lr_means ** (1 - t) * self._settings.lr_means_end**t
        return float(rate * self._cooled(step, cooling_from))

    def grows(self, step: int, cooling_from: int | None = None) -> bool:
        """Whether Gaussians are relocated and added after the step."""
        s = self._settings
        due = step > 0 and step % s.grow_interval == 0 and step >= s.grow_from * s.steps
        return due and not self.growth_ended(step, cooling_from)

    def gaussians_after_growth(self, step: int, n: int) -> int:
        """Return how many Gaussians `n` become when they grow at the step.

        With ``growth="error"`` as many as the pictures' size asks for: a small picture shows no more detail.
        """
        s = self._settings
        if s.growth == "error":
            return max(n, min(int(s.max_gaussians * self.scale(step)), max(n + 1, int(n * _LARGEST_FACTOR))))
        return max(n, min(s.max_gaussians, max(n + 1, int(n * s.grow_factor))))

    def growth_ended(self, step: int, cooling_from: int | None = None) -> bool:
        """Whether no Gaussian is relocated or added any more."""
        return step >= min(self._settings.grow_until * self._settings.steps, self.cooling_start(cooling_from))

    def done(self, step: int) -> float:
        """Return the share of the whole work done before the step, 0 to 1."""
        return float(self._work[step] / self._work[-1])


def _flat_checks(settings: TrainingSettings, cooling_start: int) -> frozenset[int]:
    """Return the numbers of finished steps after which it is asked whether more are worth it."""
    if settings.stop_when_flat == 0:
        return frozenset()
    first = math.ceil(settings.coarse_until * settings.steps)
    return frozenset(range(first, cooling_start, max(1, settings.steps // _FLAT_CHECKS)))


def _log_spaced(steps: int, n: int) -> frozenset[int]:
    """Return up to `n` numbers of finished steps, evenly spaced in the logarithm, the last one `steps`."""
    first = min(steps, max(10, steps // 64))
    return frozenset(int(round(value)) for value in np.geomspace(steps, first, n))


def _trials(settings: TrainingSettings, n_steps: int, cooling_start: int) -> dict[int, str]:
    """Return what is tried, by the number of finished steps after which it is: "exposure", or the number of a band."""
    trials = {settings.sh_interval * band: str(band) for band in range(1, settings.sh_degree + 1)}
    if settings.exposure:
        step = round(_EXPOSURE_TRIAL * settings.steps)
        while step in trials:
            step += 1
        trials[step] = EXPOSURE
    return {step: what for step, what in trials.items() if step + n_steps <= cooling_start}
