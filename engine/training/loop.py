"""The training loop: from initial Gaussians and photos to trained Gaussians and their error curve."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from ..core.arrays import evenly_spaced_indices
from ..core.errors import Cancelled, DiskError
from ..core.events import Emit, Metric, Preview, Progress, StopCheck, Warned
from ..core.parts import part
from ..install.models import one_thread
from ..scene import Gaussians
from .adam import AdamState
from .checkpoint import RunState, continues, read_checkpoint, run_key, write_checkpoint
from .compilation import compile_kernels
from .coverage import Coverage
from .cpu_steps import CpuSteps
from .guards import check_result, check_start, clamp_parameters, translate_out_of_memory
from .held_out import MAX_MEASURED_PHOTOS, Clock, CurvePoint, flat_psnr, mean_color, measure, write_picture
from .parameters import Parameters
from .quality import measure_levels
from .result import TrainingResult, make_result
from .schedule import THIN, Schedule
from .settings import PREVIEW_FILE, TEST_PHOTOS, TrainingSettings
from .spectrum import coarse_shares
from .start import EmptySpace, StartPoints
from .steps import Inputs, Steps
from .thinning import MAX_CAMERAS, SIDE, changes_by_removal, thin
from .transients import find_transients
from .trials import Trial, brightness_factors, exposure_corrected_quality
from .views import Level, TrainingView, ViewPyramid, scene_extent

STAGE = "training"

CANCELLED_MESSAGE = "Training was cancelled; the next run continues from where it stopped."

FIRST_PREVIEW_SECONDS = 2.0
"""Time of the first preview after the start."""

EVENT_INTERVAL = 1.0
"""Shortest time between two progress events, seconds."""

GOOD_PSNR = 30.0  # chosen on stability_scenes
"""PSNR in dB, a mean error of 3 %, from which no warning is given, however uniform the photos are."""

TRANSIENT_SEARCH_SIDE = 100.0  # chosen on museum_room
"""Longest side of a picture that is large enough to find transients, pixels."""

STEPS_SECONDS = 0.5
"""Time after which steps that are made at once end, so that progress is seen and a run can be cancelled."""

MAX_STEPS_AT_ONCE = 64
"""Largest number of them."""


def train(
    start: Gaussians,
    views: Sequence[TrainingView],
    settings: TrainingSettings,
    *,
    checkpoints: Path,
    emit: Emit,
    should_stop: StopCheck,
    background: Gaussians | None = None,
) -> TrainingResult:
    """Train Gaussians until they look like the photos from the photos' cameras.

    Minimises L_rendering + lambda_clustering L_CC + L_reg (Dahaghin et al. 2024) with Adam, one photo per step.
    Pictures are composited over black, so that space that no photo constrains stays empty.

    Parameters
    ----------
    start : Gaussians
        See `gaussians.initialise`; with features when ``train_features`` is set and any view has labels.
    views : sequence of TrainingView
        Held-out ones, the test photos, are only measured: the error curve and the preview read them, and nothing that
        the Gaussians depend on does.
    checkpoints : Path
        Folder for the checkpoint, from which an interrupted run with the same inputs resumes, and for the preview.
    emit : Emit
        Receives Progress, Metric (``loss``, ``psnr``, ``gaussians``), Preview, Warned.
    should_stop : StopCheck
        Called before each step.
    background : Gaussians, optional
        See `background_gaussians`. Only their features are trained; they come first in the result.

    Returns
    -------
    TrainingResult

    Raises
    ------
    TrainingError
        When there are no Gaussians or no photos, a photo and its camera differ in size, or nothing is visible in the
        result.
    Cancelled
        When `should_stop` returns true; a checkpoint has been written.
    NumericalError
        When the initial Gaussians, the loss or the result are not finite.
    EnvironmentProblem
        When memory is full; the last checkpoint is kept.
    DiskError
        When a checkpoint cannot be written.

    Notes
    -----
    A resumed run gives the same Gaussians, bit for bit, as an uninterrupted one on the same computer.
    """
    with translate_out_of_memory(), one_thread():
        # Not in the first step, because the clock of the error curve must not include work done once per computer.
        if settings.backend == "cpu":
            emit(Progress(STAGE, 0.0, message="compiling the rasterizer, once per computer, or loading it"))
            with part("compilation"):
                compile_kernels()
        elif settings.backend == "gpu":
            emit(Progress(STAGE, 0.0, message="testing the graphics card"))
        with part("preparing the steps"):
            run = _TrainingRun(start, views, settings, checkpoints, emit, should_stop, background)
        if run.state.step:
            emit(Progress(STAGE, run.schedule.done(run.state.step), message="continued from a checkpoint"))
            run.emit_curve(run.state.curve)
        while not run.finished:
            if should_stop():
                run.write_checkpoint()
                raise Cancelled(CANCELLED_MESSAGE)
            with part("steps"):
                run.advance()
            run.report()
        with part("measurements"):
            run.check()
            return run.result()


class _TrainingRun:
    """One training run. Everything that changes is in `state`, which a checkpoint stores."""

    def __init__(
        self,
        start: Gaussians,
        views: Sequence[TrainingView],
        settings: TrainingSettings,
        checkpoints: Path,
        emit: Emit,
        should_stop: StopCheck,
        background: Gaussians | None,
    ) -> None:
        training = [view for view in views if not view.held_out]
        held_out = [view for view in views if view.held_out]
        check_start(start)
        points = start.means
        n_background = 0
        if background is not None and len(background):
            check_start(background)
            n_background, start = len(background), background.joined(start)
        self.settings, self.checkpoints, self.emit, self.should_stop = settings, checkpoints, emit, should_stop
        self.pyramid = ViewPyramid(training, settings.features, prepares_targets=settings.backend != "gpu")
        self.measured_on = TEST_PHOTOS if held_out else "training photos"
        self.measured = ViewPyramid(_measured_views(held_out or training), settings.features)
        extent = scene_extent([view.pinhole for view in training])
        eyes = np.array([view.pinhole.center for view in training])
        is_published = settings.growth.growth_strategy == "opacity"
        empty_space = None if is_published else EmptySpace(points, eyes)
        center = torch.tensor(eyes.mean(axis=0), dtype=torch.float32)
        labelled = [
            i for i, view in enumerate(training) if settings.features.train_features and view.labels is not None
        ]
        shares = coarse_shares(training, 2 * settings.schedule.coarse_levels)
        self.schedule = Schedule(settings, len(training), extent, labelled=labelled, shares=shares)
        self.inputs = Inputs(settings, self.pyramid, StartPoints(points), empty_space, center, extent)
        self.steps = _open_steps(self.inputs)
        self.key = run_key(start, views, settings)
        begun = self._initial_state(start, n_background)
        stored = read_checkpoint(checkpoints, self.key)
        if stored is None or not continues(stored, begun, n_steps=settings.schedule.steps):
            stored = begun
        self.state = stored
        self.state.parameters.n_background = n_background
        self._use(self.state, self.schedule)
        self.clock = Clock(self.state.wall_seconds, self.state.cpu_seconds)
        self._first_wall, self._first_done = self.clock.wall, self.schedule.done(self.state.step)
        self._loss = float("nan")
        self._steps_at_once = 1
        self._warned_of_preview = False
        self._reported = self._stored = time.monotonic()
        # The first preview after some steps, not only after the time between two.
        interval = settings.measurement.preview_seconds
        self._previewed = self._reported + min(FIRST_PREVIEW_SECONDS, interval) - interval
        if not held_out:
            emit(Warned("There are too few photos for test photos; errors are measured on the training photos."))

    def _initial_state(self, start: Gaussians, n_background: int) -> RunState:
        settings, training = self.settings, self.pyramid.views
        features = settings.features.train_features and any(view.labels is not None for view in training)
        exposure = torch.zeros(len(training), 3)
        parameters = Parameters.from_gaussians(start, sh_degree=settings.appearance.sh_degree, features=features)
        parameters.n_background = n_background
        state = RunState(
            parameters,
            exposure,
            AdamState.zeros_like(exposure),
            sh_limit=0 if self.schedule.trial_steps else None,
        )
        clamp_parameters(state.parameters, self.inputs.center, self.inputs.extent, state.guards)
        return state

    def _use(self, state: RunState, schedule: Schedule) -> None:
        """Train `state` by `schedule` from now on."""
        self.state, self.schedule = state, schedule
        self.pyramid.mask_pixels(state.transient_masks)
        self.steps.use(state, schedule)

    @property
    def finished(self) -> bool:
        """Whether training ends here; depends on the state only, so that resuming is exact."""
        return self.state.step >= self.settings.schedule.steps

    def advance(self) -> None:
        """Make one training step, and before it a trial when one is due."""
        state, schedule = self.state, self.schedule
        band = schedule.trials.get(state.step)
        # A band is tried only when the band below it passed its trial.
        if band is not None and band == (state.sh_limit or 0) + 1:
            self._run_trial(band)
        if schedule.validation and self.settings.appearance.exposure and state.step == schedule.validation_until:
            self.steps.store()
            state.exposure.detach()[list(schedule.validation)] = self._fitted_exposure(schedule.validation)
            self.steps.use(state, schedule)
        self._advance(min(step for step in self._stops() if step > state.step))

    def _stops(self) -> Iterator[int]:
        """Yield numbers of finished steps at which something else than steps is due."""
        schedule = self.schedule
        yield self.settings.schedule.steps
        yield from schedule.curve_steps
        yield from schedule.trials
        yield from schedule.thinnings
        yield from schedule.searches_for_transients
        yield schedule.validation_until
        if self.steps.checkpoint_seconds is None:
            interval = self.settings.schedule.checkpoint_interval
            yield (self.state.step // interval + 1) * interval

    def _run_trial(self, band: int) -> None:
        """Train two copies, without `band` and with it, and use it from now on if that gains enough."""
        state, schedule = self.state, self.schedule
        self.write_checkpoint()  # A run that is stopped during a trial resumes before it.
        without, with_it = (
            self._psnr_in_trial(state.copy(), limit, n_before)
            for limit, n_before in ((state.sh_limit or 0, 0), (band, schedule.trial_steps))
        )
        kept = with_it - without >= self.settings.appearance.min_trial_gain
        state.trials.append(Trial(str(band), state.step, schedule.trial_steps, with_it - without, kept))
        if kept:
            state.sh_limit = band
        else:
            state.parameters.cut_sh(state.sh_limit or 0)
        self._use(state, schedule)

    def _psnr_in_trial(self, state: RunState, sh_limit: int, n_before: int) -> float:
        """Train `state` for the steps of a trial with falling rates and return the PSNR on the validation photos.

        The cooldown is needed because at full rates the PSNR depends on the last photos trained on. `n_before` steps
        of the trial are made.
        """
        begun = state.step
        end = begun + self.schedule.trial_steps
        state.sh_limit = sh_limit
        self._use(state, self.schedule.of_trial(state.step))
        while state.step < end:
            if self.should_stop():
                raise Cancelled(CANCELLED_MESSAGE)
            self._advance(end)
            done = self.schedule.done(begun, n_before + state.step - begun)
            self._emit_progress(
                f"step {state.step} of {self.settings.schedule.steps}, trying view-dependent colours", done
            )
        levels = [self.pyramid.level(view, 0) for view in self.schedule.validation]
        measure_trial = exposure_corrected_quality if self.settings.appearance.exposure else measure
        return measure_trial(self._picture, levels).psnr

    def _fitted_exposure(self, views: Sequence[int]) -> torch.Tensor:
        """Return the logarithms of the brightness factors that fit the current pictures of `views` best, [n, 3]."""
        reductions = self.schedule.reductions(self.state.step)
        levels = [self.pyramid.level(view, reductions) for view in views]
        return torch.stack([brightness_factors(self._picture(level), level).log() for level in levels])

    def _picture(self, level: Level) -> torch.Tensor:
        return self.steps.picture(level, self._sh_degree())

    def _sh_degree(self) -> int:
        """Return the highest band that the last step used."""
        return self.schedule.sh_degree(max(0, self.state.step - 1), self.state.sh_limit)

    def _advance(self, end: int) -> None:
        """Make steps, at most up to `end` finished ones, and search transients when it is due."""
        state, schedule = self.state, self.schedule
        with self.clock:
            before, reductions = self.clock.wall, schedule.reductions(state.step)
            begun = state.step
            self._loss = self.steps.advance(min(self._steps_at_once, end - begun))
            fitting = (state.step - begun) * STEPS_SECONDS / max(self.clock.wall - before, 1e-6)
            self._steps_at_once = max(1, min(int(fitting), MAX_STEPS_AT_ONCE))
            if state.step in schedule.searches_for_transients:
                self._search_transients()
            if state.step in schedule.thinnings:
                self._thin(schedule.thinnings[state.step])
            if schedule.reductions(state.step) != reductions:
                self.pyramid.free_smaller_levels(schedule.reductions(state.step))

    def _search_transients(self) -> None:
        side = max(max(view.pinhole.width, view.pinhole.height) for view in self.pyramid.views)
        # Not larger than the size trained on so far: what is still blurred there is not a transient.
        sufficient = math.floor(2.0 * math.log2(max(1.0, side / TRANSIENT_SEARCH_SIDE)))
        reductions = max(self.schedule.reductions(self.state.step - 1), sufficient)
        self.steps.store()
        masks = find_transients(
            self.state.parameters,
            [self.pyramid.unmasked_level(view, reductions) for view in range(len(self.pyramid.views))],
            backend=self.settings.backend,
            sh_degree=self._sh_degree(),
        )
        self.state.transient_masks = {view: mask for view, mask in enumerate(masks) if mask is not None}
        self.pyramid.mask_pixels(self.state.transient_masks)

    def _thin(self, n: int) -> None:
        """Remove the Gaussians that the pictures need least, until `n` are left."""
        state, schedule = self.state, self.schedule
        self.steps.store()
        views = schedule.trained_on(state.step)
        cameras = [self.pyramid.views[views[i]].pinhole for i in evenly_spaced_indices(len(views), MAX_CAMERAS)]
        changes = changes_by_removal(
            state.parameters.values, [camera.reduced(SIDE) for camera in cameras],
            backend=self.settings.backend, sh_degree=self._sh_degree(), generator=schedule.generator(state.step, THIN),
        )  # fmt: skip
        thin(state.parameters, changes, n)
        self.steps.use(state, schedule)

    def report(self) -> None:
        """Measure the error, write the preview and a checkpoint, and emit progress, each when it is due."""
        state, now = self.state, time.monotonic()
        finished = self.finished
        if state.step in self.schedule.curve_steps or finished:
            with part("measurements"):
                self._measure()
        if now - self._previewed >= self.settings.measurement.preview_seconds or finished:
            self._previewed = now
            with part("previews"):
                self._preview()
        if self._checkpoint_is_due(now) or finished:
            with part("writing"):
                self.write_checkpoint()
        done = self.schedule.done(state.step)
        self._emit_progress(f"step {state.step} of {self.settings.schedule.steps}", done, finished=finished)

    def _checkpoint_is_due(self, now: float) -> bool:
        seconds = self.steps.checkpoint_seconds
        if seconds is None:
            return self.state.step % self.settings.schedule.checkpoint_interval == 0
        return now - self._stored >= seconds

    def _emit_progress(self, message: str, done: float, *, finished: bool = False) -> None:
        """Emit progress and metrics, at most once per second except at the end; `done` is a fraction of the run."""
        state, now = self.state, time.monotonic()
        if now - self._reported < EVENT_INTERVAL and not finished:
            return
        self._reported = now
        self.emit(Metric(STAGE, "loss", self._loss, state.step))
        self.emit(Metric(STAGE, "gaussians", float(self.steps.n_gaussians), state.step))
        spent = (self.clock.wall - self._first_wall) / (done - self._first_done)
        self.emit(Progress(STAGE, done, spent * (1.0 - done), message))

    def _levels(self) -> list[Level]:
        return [self.measured.level(index, 0) for index in range(len(self.measured.views))]

    def _measure(self) -> None:
        self.state.curve.append(self._curve_point(self._levels()))
        self.emit_curve(self.state.curve[-1:])

    def _curve_point(self, levels: Sequence[Level]) -> CurvePoint:
        state = self.state
        quality = measure(self._picture, levels)
        return CurvePoint(
            state.step, self.clock.wall, self.clock.cpu, quality.psnr, quality.ssim, quality.l1, self.steps.n_gaussians
        )

    def emit_curve(self, points: Sequence[CurvePoint]) -> None:
        """Emit measurements; after resuming, the whole curve, for viewers that plot it."""
        for point in points:
            self.emit(Metric(STAGE, "psnr", point.psnr, point.step, point.wall_seconds))

    def _preview(self) -> None:
        level = self.measured.level(len(self.measured.views) // 2, 0)
        image = self._picture(level)
        path = self.checkpoints / PREVIEW_FILE
        try:
            write_picture(path, image)
        except DiskError as error:
            # A viewer may hold the picture. What the scene needs is written in checkpoints, which report a full disk.
            if not self._warned_of_preview:
                self._warned_of_preview = True
                self.emit(Warned(f"There is no new preview. {error}"))
            return
        self.emit(Preview(STAGE, str(path)))

    def write_checkpoint(self) -> None:
        """Write the current state."""
        self.steps.store()
        self._stored = time.monotonic()
        self.state.wall_seconds, self.state.cpu_seconds = self.clock.wall, self.clock.cpu
        write_checkpoint(self.checkpoints, self.key, self.state)

    def check(self) -> None:
        """Refuse a result without content; warn of one that is no better than a flat colour."""
        views = evenly_spaced_indices(len(self.pyramid.views), MAX_MEASURED_PHOTOS)
        black = flat_psnr(np.zeros(3), [self.pyramid.level(view, 0) for view in views])
        check_result(self.state.parameters, photos_are_black=black >= GOOD_PSNR)
        psnr, flat = self.state.curve[-1].psnr, flat_psnr(mean_color(self.pyramid.views), self._levels())
        if psnr < min(flat, GOOD_PSNR):
            self.emit(
                Warned(
                    f"The trained scene matches the {self.measured_on} no better ({psnr:.1f} dB) than one flat colour "
                    f"({flat:.1f} dB). Check photos and cameras; if learning rates were raised, lower them."
                )
            )

    def result(self) -> TrainingResult:
        """Return the result of the finished run."""
        measured = [view.photo for view in self.measured.views]
        photos = [view.photo for view in self.pyramid.views]
        values = self.state.parameters.values
        coverage = Coverage(values, [view.pinhole for view in self.pyramid.views], backend=self.settings.backend)
        quality = measure_levels(self._picture, self._levels(), coverage)
        return make_result(
            self.state,
            self.settings,
            self.schedule,
            quality,
            photos=photos,
            measured_on=self.measured_on,
            measured=measured,
        )


def _open_steps(inputs: Inputs) -> Steps:
    if inputs.settings.backend == "gpu":
        from .gpu import GpuSteps

        return GpuSteps(inputs)
    return CpuSteps(inputs)


def _measured_views(views: Sequence[TrainingView]) -> list[TrainingView]:
    return [views[index] for index in evenly_spaced_indices(len(views), MAX_MEASURED_PHOTOS)]
