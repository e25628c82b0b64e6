"""The schedule of a training run as pure functions of the step, so that a resumed run is exact.

Forecasts read it: torch is imported only where a run draws random numbers.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .settings import MAX_GROW_FACTOR, TrainingSettings
from .validation import validation_photos

if TYPE_CHECKING:
    import torch

SAMPLE, ANCHORS, RELOCATE, GROW, NOISE, DROP, THIN = 1, 2, 3, 4, 5, 6, 7
"""Purposes of random draws, see `Schedule.generator`."""

SIZE_INDEPENDENT_WORK = 0.25  # chosen on museum_room
"""Time of projection and Adam, which do not depend on the size of the picture, per time of the pixels of a full-size
step. Used only to estimate the remaining time."""

LAST_DECISION = 0.75  # chosen on museum_room
"""Fraction of the steps after which nothing is decided any more, so that the validation photos are trained on in the
rest. See docs/design_notes/training.md."""

TRANSIENT_SEARCHES = (0.2, 0.4)  # chosen on museum_room
"""Fractions of the steps after which transients are searched. Each search replaces the result of the one before:
Gaussians that fitted a transient fade once its pixels are left out."""

THINNINGS = (0.6, 0.7, 0.8)  # chosen on room_6, meeting_place9
"""Fractions of the steps after which Gaussians are removed, where fewer are kept than there may be."""

_COARSE_UNTIL = 0.5  # chosen on museum_room, sakharov_statue32
"""Fraction of the steps that smaller pictures would take if full size added no detail. Each size takes as much of it as
the share of the photos' detail that it adds."""

TYPICAL_SHARES = (
    1.0, 0.91, 0.78, 0.63, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1
)  # fmt: skip  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Shares of pictures reduced by sqrt(2) 0, 1, ... 10 times, used without photos. See docs/design_notes/training.md."""

COOLDOWN_END = 0.05  # chosen on museum_room, sakharov_statue32
"""Factor that the cooldown applies to the learning rates at its end; exponential."""


class Schedule:
    """The schedule of one run.

    Parameters
    ----------
    n_views : int
        Number of training photos.
    extent : float
        Extent of the scene, world units.
    labelled : sequence of int
        Numbers of the training photos with labels.
    shares : sequence of float
        Shares of the photos' detail that smaller pictures show, see `spectrum.coarse_shares`.

    Attributes
    ----------
    validation : tuple of int
        Numbers of the training photos that decisions are made on; empty where nothing is to be decided.
    trials : dict of int to int
        Bands that are tried, by the number of finished steps before each trial.
    trial_steps : int
        Steps of each trial, 0 in a run without trials.
    validation_until : int
        Number of finished steps after which the last trial is made and all photos are trained on.
    curve_steps : frozenset of int
        Numbers of finished steps after which the test photos are measured.
    searches_for_transients : frozenset of int
    thinnings : dict of int to int
        Numbers of Gaussians that are left, by the number of finished steps after which others are removed.
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
        coarse = _COARSE_UNTIL * settings.schedule.steps
        self._coarse_ends = [coarse * share for share in shares[1 : 2 * settings.schedule.coarse_levels + 1]]
        self._cooling_steps = round(settings.schedule.cooldown * settings.schedule.steps)
        searches = TRANSIENT_SEARCHES if settings.appearance.transients else ()
        self.searches_for_transients = frozenset(max(1, round(part * settings.schedule.steps)) for part in searches)
        self.thinnings = self._numbers_left() if settings.growth.kept < 1 else {}
        self.trial_steps = settings.trial_steps(n_views)
        self._cooling_start = settings.schedule.steps - self._cooling_steps
        self.trials = self._bands_to_try() if self.trial_steps else {}
        self.validation = validation_photos(n_views) if self.trials else ()
        self.validation_until = max(self.trials, default=0)
        # A trial, of two copies, is counted with the step behind it.
        n_with_trial = [1 + 2 * self.trial_steps * (step in self.trials) for step in range(settings.schedule.steps)]
        self._work = np.concatenate([[0.0], np.cumsum([n * self._cost(s) for s, n in enumerate(n_with_trial)])])
        self.curve_steps = _log_spaced(settings.schedule.steps, settings.measurement.curve_points)

    def trained_on(self, step: int) -> list[int]:
        """Return the numbers of the training views that are in use at the step."""
        left_out = self.validation if step < self.validation_until else ()
        return [view for view in range(self._n_views) if view not in left_out]

    def view(self, step: int) -> int:
        """Return the number of the training view of the step: each once per round, in a new random order each round.

        When only some views have labels, the steps that evaluate L_CC use these, each once per round of their own.
        Rounds begin anew when the validation photos are added.
        """
        interval = self._settings.features.clustering_interval
        views = self.trained_on(step)
        labelled = self._labelled if len(views) == self._n_views else [i for i in self._labelled if i in set(views)]
        begun = self.validation_until if step >= self.validation_until else 0
        if not 0 < len(labelled) < len(views):
            return self._place_in_round(step - begun, views, 0)
        n_labelled_steps = -(-step // interval) - -(-begun // interval)
        if step % interval == 0:
            return self._place_in_round(n_labelled_steps, labelled, 1)
        return self._place_in_round(step - begun - n_labelled_steps, views, 0)

    def _place_in_round(self, index: int, views: Sequence[int], kind: int) -> int:
        round_number, place = divmod(index, len(views))
        order = np.random.default_rng((self._settings.seed, kind, round_number)).permutation(len(views))
        return views[int(order[place])]

    def reductions(self, step: int) -> int:
        """Return how often the pictures are reduced by sqrt(2) at the step.

        Each size is used for the share of the coarse steps that equals the share of the photos' detail that it adds to
        the smaller sizes. The idea is from DashGaussian (Chen et al. 2025); the implementation is our own.
        """
        return sum(step < end for end in self._coarse_ends)

    def scale(self, step: int) -> float:
        """Return the relative size of the pictures at the step, 1 for full size."""
        return float(2.0 ** (-self.reductions(step) / 2))

    def sh_degree(self, step: int, limit: int | None = None) -> int:
        """Return the highest band of spherical harmonics at the step, at most `limit`, which trials set."""
        degree = min(self._settings.appearance.sh_degree, step // self._settings.appearance.sh_interval)
        return degree if limit is None else min(degree, limit)

    def dropout(self, step: int) -> float:
        """Return the fraction of the Gaussians that are left out of the picture of the step."""
        return self._settings.loss.dropout * step / self._settings.schedule.steps

    def lambda_opacity(self, step: int) -> float:
        """Return the weight of the mean opacity at the step."""
        loss, grow_from = self._settings.loss, self._settings.growth.grow_from
        return loss.lambda_opacity if step < grow_from * self._settings.schedule.steps else loss.lambda_opacity_end

    def generator(self, step: int, purpose: int) -> torch.Generator:
        """Return a fresh random generator for one `purpose` at one step."""
        import torch

        state = np.random.SeedSequence((self._settings.seed, step, purpose)).generate_state(1, np.uint64)[0]
        return torch.Generator().manual_seed(int(state >> np.uint64(1)))

    def of_trial(self, step: int) -> Schedule:
        """Return the schedule of a trial that begins at `step`, with a cooldown that takes all of its steps.

        All bands have the rate of band 0: at their own, higher bands need about a thousand steps. See
        docs/design_notes/training.md. The validation photos are not trained on.
        """
        trial = copy.copy(self)
        trial._cooling_start, trial._cooling_steps = step, self.trial_steps
        trial.validation_until = self._settings.schedule.steps
        trial.thinnings = {}
        trial._settings = self._settings.changed(lr_sh_rest=self._settings.optimiser.lr_sh)
        return trial

    def _cooled(self, step: int) -> float:
        done = step - self._cooling_start
        return float(COOLDOWN_END ** (done / self._cooling_steps)) if done > 0 else 1.0

    def learning_rates(self, step: int) -> dict[str, float]:
        """Return the learning rate of every parameter at the step."""
        optimiser, decay = self._settings.optimiser, self._decay(step)
        return {
            "means": self.means_rate(step) * self._extent,
            "log_scales": optimiser.lr_scales * decay,
            "quats": optimiser.lr_quats * decay,
            "opacity_logits": optimiser.lr_opacity * decay,
            "sh_dc": optimiser.lr_sh * decay,
            "sh_rest": optimiser.lr_sh_rest * decay,
            "features": optimiser.lr_features * decay,
        }

    def exposure_rate(self, step: int) -> float:
        """Return the learning rate of the brightness factors at the step."""
        return self._settings.optimiser.lr_exposure * self._decay(step)

    def _decay(self, step: int) -> float:
        """Return the factor of all learning rates but that of the positions."""
        t = step / max(self._settings.schedule.steps - 1, 1)
        return self._settings.optimiser.lr_end ** max(0.0, 2.0 * t - 1.0) * self._cooled(step)

    def means_rate(self, step: int) -> float:
        """Return the learning rate of the positions at the step, per extent."""
        t = step / max(self._settings.schedule.steps - 1, 1)
        rate = self._settings.optimiser.lr_means ** (1 - t) * self._settings.optimiser.lr_means_end**t
        return float(rate * self._cooled(step))

    def grows(self, step: int) -> bool:
        """Return whether Gaussians are relocated and added after the step."""
        growth = self._settings.growth
        due = step > 0 and step % growth.grow_interval == 0 and step >= growth.grow_from * self._settings.schedule.steps
        return due and not self.growth_ended(step)

    def gaussians_after_growth(self, step: int, n: int) -> int:
        """Return the number of Gaussians after growth of `n` Gaussians at the step.

        With ``growth_strategy="mixed"``, the limit is proportional to the size of the pictures, because small pictures
        show less detail. None are added once Gaussians have been removed, see `thinnings`.
        """
        growth = self._settings.growth
        if growth.kept < 1 and step >= THINNINGS[0] * self._settings.schedule.steps:
            return n
        limit = growth.max_gaussians
        if growth.growth_strategy == "mixed":
            limit = int(limit * self.scale(step))
        return max(n, min(limit, max(n + 1, int(n * self._grow_factor(step, n)))))

    def _grow_factor(self, step: int, n: int) -> float:
        """Return the factor of the growth of `n` Gaussians after the step, see `GrowthSettings`."""
        growth = self._settings.growth
        if growth.growth_strategy == "opacity":
            return growth.grow_factor
        full_at = growth.grow_from + growth.full_by * (growth.grow_until - growth.grow_from)
        n_after = max(0, int(full_at * self._settings.schedule.steps) - step) // growth.grow_interval
        return float(min((growth.max_gaussians / n) ** (1.0 / (1 + n_after)), MAX_GROW_FACTOR))

    def growth_ended(self, step: int) -> bool:
        """Return whether Gaussians are no longer relocated or added."""
        return step >= min(self._settings.growth.grow_until * self._settings.schedule.steps, self._cooling_start)

    def _numbers_left(self) -> dict[int, int]:
        """Return the numbers of Gaussians that are left after each removal, by equal factors, see `thinnings`."""
        growth = self._settings.growth
        parts = [(place + 1) / len(THINNINGS) for place in range(len(THINNINGS))]
        return {
            max(1, round(at * self._settings.schedule.steps)): max(1, round(growth.max_gaussians * growth.kept**part))
            for at, part in zip(THINNINGS, parts, strict=True)
        }

    def _bands_to_try(self) -> dict[int, int]:
        """Return the bands that are tried, see `trials`."""
        settings, steps = self._settings, self._settings.schedule.steps
        last = min(math.floor(LAST_DECISION * steps), self._cooling_start - self.trial_steps)
        bands = {settings.appearance.sh_interval * band: band for band in range(1, settings.appearance.sh_degree + 1)}
        return {step: band for step, band in bands.items() if step <= last}

    def done(self, step: int, in_trial: int = 0) -> float:
        """Return the fraction of the run time, 0 to 1, before the step and `in_trial` steps of a trial before it."""
        return float((self._work[step] + in_trial * self._cost(step)) / self._work[-1])

    def _cost(self, step: int) -> float:
        """Return the run time of the step, in that of the pixels of a full-size picture."""
        return SIZE_INDEPENDENT_WORK + self.scale(step) ** 2


def _log_spaced(steps: int, n: int) -> frozenset[int]:
    """Return up to `n` numbers of finished steps, evenly spaced in the logarithm, of which the last is `steps`."""
    first = min(steps, max(10, steps // 64))
    return frozenset(int(round(value)) for value in np.geomspace(steps, first, n))
