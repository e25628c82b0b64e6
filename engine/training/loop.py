"""The training loop: Gaussians to start from and photos in, trained Gaussians and their error curve out."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from ..errors import Cancelled
from ..events import Emit, Metric, Preview, Progress, StopCheck, Warned
from ..rasterizer import AdamState, adam_step, warm_up
from ..scene import Gaussians
from .checkpoint import RunState, read_checkpoint, run_key, write_checkpoint
from .densify import error_votes, grow, grow_where_wrong, position_noise, relocate
from .guards import (
    backward,
    check_result,
    check_start,
    clamp_parameters,
    step_finite_rows,
    translate_out_of_memory,
)
from .held_out import Clock, CurvePoint, expected_gain, flat_psnr, measure, render_picture, write_picture
from .parameters import Parameters
from .result import TrainingResult, result_of
from .schedule import Schedule
from .settings import TrainingSettings
from .spectrum import coarse_shares
from .step import step_loss
from .transients import find_transients
from .trials import EXPOSURE, Trial, brightness_factors, quality_but_for_brightness
from .views import Level, TrainingView, ViewPyramid, scene_extent

__all__ = ["PREVIEW_FILE", "train"]

STAGE = "training"
PREVIEW_FILE = "preview.png"
_CANCELLED = "Training was cancelled; the next run continues from where it stopped."
_SECONDS_BETWEEN_EVENTS = 1.0
_MOST_MEASURED = 8
_VIEWS_THAT_VOTE = 3
_LIKE_THE_PHOTOS = 30.0
"""dB, a mean error of 3 %: better pictures are never complained about, however flat the photos are."""
_SIDE_TO_FIND = 100.0
"""Pixels of the longest side that are enough to look for who walks by."""
_NAMES_OF_TRIALS = "colours that change with the view", "a brightness factor per photo"
_RELOCATE, _GROW, _NOISE = 3, 4, 5
"""Purposes of random draws."""


def train(
    start: Gaussians,
    views: Sequence[TrainingView],
    settings: TrainingSettings,
    *,
    checkpoints: Path,
    emit: Emit,
    should_stop: StopCheck,
) -> TrainingResult:
    """Train Gaussians until they look like the photos from the photos' cameras.

    Minimises L_rendering + lambda_clustering L_CC + L_reg (Dahaghin et al. 2024) with Adam, one photo a step. Pictures
    are composited over black: what no photo decides stays empty.

    Parameters
    ----------
    start : Gaussians
        See `gaussians.initialise`; with features when ``settings.features`` and any view has labels.
    views : sequence of TrainingView
        Held-out ones are only measured on.
    settings : TrainingSettings
    checkpoints : Path
        Folder for the checkpoint, from which an interrupted run with the same inputs goes on, and the preview picture.
    emit : Emit
        Gets Progress, Metric (``loss``, ``psnr``, ``gaussians``), Preview, Warned.
    should_stop : StopCheck
        Asked each step.

    Returns
    -------
    TrainingResult

    Raises
    ------
    TrainingError
        When there is nothing to train from or on, a photo is of another size than its camera, or nothing can be seen
        of the result.
    Cancelled
        When asked to stop; a checkpoint has been written.
    NumericalError
        When the start, the loss or the result is not finite.
    EnvironmentProblem
        When memory is full; the last checkpoint is kept.
    DiskError
        When a checkpoint cannot be written.

    Notes
    -----
    A resumed run gives the same Gaussians, bit for bit, as an uninterrupted one on the same computer.
    """
    with translate_out_of_memory(), _one_torch_thread():
        if settings.backend == "cpu":
            # Here and not in the first step: the error curve's clock must not count what happens once per computer.
            emit(Progress(STAGE, 0.0, message="compiling the rasterizer, once per computer, or loading it"))
            warm_up()
        run = _Run(start, views, settings, checkpoints, emit, should_stop)
        if run.state.step:
            emit(Progress(STAGE, run.schedule.done(run.state.step), message="continued from a checkpoint"))
            run.tell_curve(run.state.curve)
        while not run.finished:
            if should_stop():
                run.write_checkpoint()
                raise Cancelled(_CANCELLED)
            run.advance()
            run.report()
        run.check()
        return run.result()


@contextlib.contextmanager
def _one_torch_thread() -> Iterator[None]:
    """Keep torch's own small operations on one thread.

    The rasterizer, loss and Adam have their own threads. Torch's, which wait for each other by spinning, made the small
    operations 30 to 300 times slower on a machine that does anything else.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class _Run:
    """One training run: what does not change, and `state`, which does and is what a checkpoint holds."""

    def __init__(
        self,
        start: Gaussians,
        views: Sequence[TrainingView],
        settings: TrainingSettings,
        checkpoints: Path,
        emit: Emit,
        should_stop: StopCheck,
    ) -> None:
        training = [view for view in views if not view.held_out]
        held_out = [view for view in views if view.held_out]
        check_start(start)
        self.settings, self.checkpoints, self.emit, self.should_stop = settings, checkpoints, emit, should_stop
        self.pyramid = ViewPyramid(training, settings)  # Refuses to be empty.
        self._has_held_out = bool(held_out)
        self.measured_on = "held-out photos" if held_out else "training photos"
        self.measured = ViewPyramid(_spread(held_out or training, _MOST_MEASURED), settings)
        self.extent = scene_extent([view.pinhole for view in training])
        self.center = torch.tensor(np.mean([view.pinhole.center for view in training], axis=0), dtype=torch.float32)
        labelled = [i for i, view in enumerate(training) if settings.features and view.labels is not None]
        shares = coarse_shares(training, 2 * settings.coarse_levels)
        self.schedule = Schedule(settings, len(training), self.extent, labelled=labelled, shares=shares)
        self.key = run_key(start, views, settings)
        self.state = read_checkpoint(checkpoints, self.key) or self._begin(start)
        self.pyramid.leave_out(self.state.out_of_place)
        self.clock = Clock(self.state.wall_seconds, self.state.cpu_seconds)
        self._first_wall, self._first_done = self.clock.wall, self.schedule.done(self.state.step)
        self._loss = float("nan")
        self._reported = self._previewed = time.monotonic()
        if not held_out:
            emit(Warned("There are too few photos to hold any out; errors are measured on the training photos."))

    def _begin(self, start: Gaussians) -> RunState:
        settings, training = self.settings, self.pyramid.views
        features = settings.features and any(view.labels is not None for view in training)
        exposure = torch.zeros(len(training), 3)
        state = RunState(
            Parameters.from_gaussians(start, sh_degree=settings.sh_degree, features=features),
            exposure,
            AdamState.zeros_like(exposure),
            sh_limit=0 if self._tries else None,
            uses_exposure=settings.exposure and not self._tries,
        )
        clamp_parameters(state.parameters, self.center, self.extent, state.guards)
        return state

    @property
    def finished(self) -> bool:
        """Whether all steps are done or the rest is not worth it; follows from the state alone: resuming is exact."""
        return self.state.step >= self.schedule.last_step(self.state.cooling_from)

    @property
    def _tries(self) -> bool:
        # Photos that are trained on gain by everything: they cannot tell what a scene needs.
        return self._has_held_out and self.schedule.trial_steps > 0

    def _is_flat(self) -> bool:
        state, schedule = self.state, self.schedule
        # Photos that are trained on get better for ever: their curve says nothing.
        if state.step not in schedule.flat_checks or not self._has_held_out or state.cooling_from is not None:
            return False
        return expected_gain(state.curve, schedule.flat_checks, self.settings.steps) < self.settings.stop_when_flat

    def advance(self) -> None:
        """Do one training step; before it a trial when one is due."""
        state = self.state
        what = self.schedule.trials.get(state.step) if self._tries and state.cooling_from is None else None
        # A band is worth a trial only when the one below it was worth its own.
        if what is not None and (what == EXPOSURE or int(what) == (state.sh_limit or 0) + 1):
            self._try(what)
        self._step()

    def _try(self, what: str) -> None:
        """Train two copies on from here, without something and with it, and use it from here on if it pays."""
        state, schedule = self.state, self.schedule
        self.write_checkpoint()  # Who is stopped in a trial begins it again.
        without, with_it = (self._psnr_in_trial(state.copy(), what, used=used) for used in (False, True))
        self.state, self.schedule = state, schedule
        self.pyramid.leave_out(state.out_of_place)
        kept = with_it - without >= self.settings.trial_gain
        state.trials.append(Trial(what, state.step, schedule.trial_steps, with_it - without, kept))
        if kept:
            self._use(what)
        elif what != EXPOSURE:
            state.parameters.cut_sh(state.sh_limit or 0)

    def _use(self, what: str) -> None:
        if what == EXPOSURE:
            self._begin_exposure(self.state)
        else:
            self.state.sh_limit = int(what)

    def _psnr_in_trial(self, state: RunState, what: str, *, used: bool) -> float:
        """Train `state` for the steps of a trial with falling rates and return the PSNR on the held-out photos.

        At full rates it depends on the photos trained on last, by 0.1 dB: one band of colours in a room gained +0.035
        in one run and -0.126 in another. So both copies cool down.
        """
        n_steps = self.schedule.trial_steps
        self.state, self.schedule = state, self.schedule.of_trial()
        self.pyramid.leave_out(state.out_of_place)
        state.cooling_from = state.step
        if used:
            self._use(what)
        for _ in range(n_steps):
            if self.should_stop():
                raise Cancelled(_CANCELLED)
            self._step()
            self._tell(f"step {state.step} of {self.settings.steps}, trying {_NAMES_OF_TRIALS[what == EXPOSURE]}")
        compared = quality_but_for_brightness if what == EXPOSURE else measure
        return compared(state.parameters.values, self._levels(), self.settings, sh_degree=self._sh_degree()).psnr

    def _begin_exposure(self, state: RunState) -> None:
        """Use the brightness factors from now on, beginning with those that fit the pictures best."""
        shrinks = self.schedule.shrinks(state.step)
        factors = []
        for view in range(len(self.pyramid.views)):
            level = self.pyramid.level(view, shrinks)
            image = render_picture(state.parameters.values, level, self.settings, sh_degree=self._sh_degree())
            factors.append(brightness_factors(image, level).log())
        state.exposure = torch.stack(factors)
        state.exposure -= state.exposure.mean(dim=0)
        state.uses_exposure = True

    def _sh_degree(self) -> int:
        """Return the band that the last step used."""
        return self.schedule.sh_degree(max(0, self.state.step - 1), self.state.sh_limit)

    def _step(self) -> None:
        state, settings, schedule = self.state, self.settings, self.schedule
        with self.clock:
            view = schedule.view(state.step)
            shrinks = schedule.shrinks(state.step)
            level = self.pyramid.level(view, shrinks)
            state.parameters.track()
            state.exposure.requires_grad_(state.uses_exposure).grad = None
            loss = step_loss(state, level, view, schedule, settings, self.extent)
            if backward(loss, state.guards):
                step_finite_rows(state.parameters, self._update, state.guards)
            with torch.no_grad():
                self._explore()
                clamp_parameters(state.parameters, self.center, self.extent, state.guards)
            state.step += 1
            self._loss = loss.item()
            if state.step in schedule.searches_for_transients:
                self._search_for_transients()
            if schedule.shrinks(state.step) != shrinks:
                self.pyramid.forget(schedule.shrinks(state.step))

    def _update(self) -> None:
        state = self.state
        state.parameters.step(self.schedule.learning_rates(state.step, state.cooling_from))
        if state.exposure.grad is not None:
            exposure = state.exposure.detach()
            adam_step([(exposure, state.exposure.grad, self.settings.lr_exposure)], [state.exposure_moments])
            # Brightness common to all photos belongs to the Gaussians.
            exposure -= exposure.mean(dim=0)

    def _explore(self) -> None:
        """Relocate and add Gaussians when it is time; let the nearly transparent ones wander until growth ends."""
        state, settings, schedule = self.state, self.settings, self.schedule
        if schedule.grows(state.step, state.cooling_from):
            n = len(state.parameters)
            n_new = schedule.gaussians_after_growth(state.step, n) - n
            if settings.growth == "error":
                self._grow_where_wrong(n_new)
            else:
                moves, additions = (schedule.generator(state.step, purpose) for purpose in (_RELOCATE, _GROW))
                relocate(state.parameters, min_opacity=settings.min_opacity, generator=moves)
                grow(state.parameters, n_new, generator=additions)
        if settings.noise > 0 and not schedule.growth_ended(state.step, state.cooling_from):
            position_noise(
                state.parameters,
                learning_rate=schedule.means_rate(state.step, state.cooling_from),
                extent=self.extent,
                strength=settings.noise,
                generator=schedule.generator(state.step, _NOISE),
            )

    def _search_for_transients(self) -> None:
        side = max(max(view.pinhole.width, view.pinhole.height) for view in self.pyramid.views)
        # Never larger than what was trained on until now: what is blurred yet is not out of place.
        enough = math.floor(2.0 * math.log2(max(1.0, side / _SIDE_TO_FIND)))
        shrinks = max(self.schedule.shrinks(self.state.step - 1), enough)
        found = find_transients(
            self.state.parameters,
            [self.pyramid.as_given(view, shrinks) for view in range(len(self.pyramid.views))],
            self.settings,
            sh_degree=self._sh_degree(),
        )
        self.state.out_of_place = {view: mask for view, mask in enumerate(found) if mask is not None}
        self.pyramid.leave_out(self.state.out_of_place)

    def _grow_where_wrong(self, n_new: int) -> None:
        state, settings, schedule = self.state, self.settings, self.schedule
        generator = schedule.generator(state.step, _GROW)
        views = torch.randint(len(self.pyramid.views), (_VIEWS_THAT_VOTE,), generator=generator).tolist()
        levels = [self.pyramid.level(view, schedule.shrinks(state.step)) for view in views]
        degree = schedule.sh_degree(state.step, state.sh_limit)
        votes = error_votes(state.parameters, levels, settings, sh_degree=degree)
        grow_where_wrong(state.parameters, votes, n_new, min_opacity=settings.min_opacity, generator=generator)

    def report(self) -> None:
        """Measure, show, save and tell, each when it is due."""
        state, now = self.state, time.monotonic()
        finished = self.finished
        if state.step in self.schedule.curve_steps or finished:
            self._measure()
        if self._is_flat():
            state.cooling_from = state.step
        if now - self._previewed >= self.settings.preview_seconds or finished:
            self._previewed = now
            self._preview()
        if state.step % self.settings.checkpoint_interval == 0 or finished:
            self.write_checkpoint()
        message = f"step {state.step} of {self.settings.steps}"
        if finished and state.step < self.settings.steps:
            message += ": the curve is flat"
        self._tell(message, finished=finished)

    def _tell(self, message: str, *, finished: bool = False) -> None:
        """Say how far it is; not more than once a second, but for the end."""
        state, now = self.state, time.monotonic()
        if now - self._reported < _SECONDS_BETWEEN_EVENTS and not finished:
            return
        self._reported = now
        self.emit(Metric(STAGE, "loss", self._loss, state.step))
        self.emit(Metric(STAGE, "gaussians", float(len(state.parameters)), state.step))
        done = self.schedule.done(state.step)
        spent = (self.clock.wall - self._first_wall) / (done - self._first_done)
        done = 1.0 if finished else done
        self.emit(Progress(STAGE, done, spent * (1.0 - done), message))

    def _levels(self) -> list[Level]:
        return [self.measured.level(index, 0) for index in range(len(self.measured.views))]

    def _measure(self) -> None:
        state = self.state
        quality = measure(state.parameters.values, self._levels(), self.settings, sh_degree=self._sh_degree())
        state.curve.append(
            CurvePoint(
                state.step, self.clock.wall, self.clock.cpu, quality.psnr, quality.ssim, quality.l1,
                len(state.parameters),
            )
        )  # fmt: skip
        self.tell_curve(state.curve[-1:])

    def tell_curve(self, points: Sequence[CurvePoint]) -> None:
        """Say what was measured; after a resume the whole curve, for whoever draws it while it grows."""
        for point in points:
            self.emit(Metric(STAGE, "psnr", point.psnr, point.step, point.wall_seconds))

    def _preview(self) -> None:
        level = self.measured.level(len(self.measured.views) // 2, 0)
        image = render_picture(self.state.parameters.values, level, self.settings, sh_degree=self._sh_degree())
        path = self.checkpoints / PREVIEW_FILE
        write_picture(path, image)
        self.emit(Preview(STAGE, str(path)))

    def write_checkpoint(self) -> None:
        """Save the state as it is now."""
        self.state.wall_seconds, self.state.cpu_seconds = self.clock.wall, self.clock.cpu
        write_checkpoint(self.checkpoints, self.key, self.state)

    def check(self) -> None:
        """Refuse a result that is none; warn of one that a flat colour would be as good as."""
        psnr = self.state.curve[-1].psnr
        check_result(self.state.parameters, photos_are_black=psnr >= _LIKE_THE_PHOTOS)
        flat = flat_psnr(self.pyramid.views, self._levels())
        if psnr < min(flat, _LIKE_THE_PHOTOS):
            self.emit(
                Warned(
                    f"The trained scene is no more like the {self.measured_on} ({psnr:.1f} dB) than one flat colour "
                    f"({flat:.1f} dB). Check photos and cameras; where learning rates were raised, lower them."
                )
            )

    def result(self) -> TrainingResult:
        """Return what was trained, measured and guarded against."""
        measured = [view.photo for view in self.measured.views]
        photos = [view.photo for view in self.pyramid.views]
        return result_of(
            self.state, self.settings, self.schedule, photos=photos, measured_on=self.measured_on, measured=measured
        )


def _spread(views: Sequence[TrainingView], most: int) -> list[TrainingView]:
    """Return at most `most` of the views, evenly spread."""
    if len(views) <= most:
        return list(views)
    return [views[index] for index in np.linspace(0, len(views) - 1, most).round().astype(int)]
