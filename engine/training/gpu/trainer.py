"""Training steps whose data stay on the card: parameters, moments, photos.

A step computes activations, image, loss, gradients, Adam, random walk and limits, with the terms of the processor's
trainer that its plan asks for. Nothing is read back but a status after many steps. A step that needs more pairs than
the buffers hold, or meets a value that is not finite, changes nothing, and no later step does either until the
processor has read why: a batch of queued steps ends where the first one failed.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...rasterizer import MAX_CHANNELS, check_camera
from ...rasterizer.gpu import (
    STORAGE,
    FrameSize,
    Gpu,
    Timings,
    camera_values,
    grown_capacity,
    translate_card_errors,
)
from ...scene import PinholeCamera
from ..adam import BETAS, LARGEST_STEP, MAX_REFUSED_STEPS, AdamState
from ..losses import GpuExposures
from .faults import is_refusal, raise_fault
from .parameters import GROUPS, GpuParameters
from .plans import Photo, StepPlan, valid_pixels
from .rearrange import Rearrangement, check_rearrangement
from .search import NearestSearch
from .settings import StepSettings
from .training_frame import PhotoLoss, TrainingFrame
from .workspace import TrainingWorkspace

_BATCH = 64
"""Largest number of steps between two reads of the status. A larger one saves no time, and repeats more after a
failure."""

_EXPOSURE = "exposure"
_GROUPS = (*GROUPS, _EXPOSURE)  # as in optimiser.wgsl

_INPUT_NOT_FINITE = 1  # as in verdict.wgsl

_TOO_MANY_PAIRS = 16  # as in optimiser.wgsl

_HEADROOM = 1.25
"""Room that the buffers get when they have to grow, in Gaussians."""

_LOSSES = 8
"""Values of the status before the losses, as in optimiser.wgsl."""

REFUSED_STEPS = "refused_steps"

GUARDS = ("scales_at_limit", "opacities_at_limit", "clamped_positions", "reset_rotations", "gaussians_not_updated")
"""Counts in the status, by the names of the processor's trainer."""


class GpuTrainer:
    """Training steps on a card.

    Parameters
    ----------
    parameters : GpuParameters
        Changed by `steps`.
    exposures : GpuExposures, optional
        Changed by `steps`. By default, photos have no brightness factors.
    capacity : int, optional
        Pairs of a tile and a Gaussian that the buffers hold at first; they grow.
    max_gaussians : int, optional
        Gaussians that the buffers have room for from the start. By default, and beyond that, buffers that are too small
        get a quarter more room than is needed.

    Attributes
    ----------
    guards : Counter
        Gaussians at each of the limits, and Gaussians left out because the square of a gradient overflows, summed over
        the steps, see `GUARDS`; and ``refused_steps``.

    Notes
    -----
    Pictures of all sizes share their buffers. Only the gradient of the image is kept for each size of picture.
    """

    def __init__(
        self,
        gpu: Gpu,
        parameters: GpuParameters,
        settings: StepSettings | None = None,
        *,
        exposures: GpuExposures | None = None,
        capacity: int | None = None,
        max_gaussians: int | None = None,
    ) -> None:
        self.gpu, self.parameters, self.settings = gpu, parameters, settings or StepSettings()
        parameters.reserve(max_gaussians or 0)
        self.exposures = exposures or GpuExposures(gpu, np.zeros((1, 3), np.float32))
        self._capacity = capacity or max(4096, 2 * parameters.room)
        self.guards: Counter[str] = Counter()
        self._photos: dict[int, Photo] = {}
        self._n_photos = 0
        self._frames: dict[tuple[int, int, bool], TrainingFrame] = {}
        self._pool: dict[str, Any] = {}
        self._timings = Timings(gpu)
        self._status = gpu.device.create_buffer(size=4 * (_LOSSES + _BATCH), usage=STORAGE, label="status")

    def add_photo(
        self,
        camera: PinholeCamera,
        pixels: NDArray[np.uint8],
        *,
        valid: NDArray[np.bool_] | None = None,
        by_features: NDArray[np.float32] | None = None,
        view: int = 0,
    ) -> int:
        """Copy a photo to the card, 4 bytes per pixel, and return its number.

        Parameters
        ----------
        pixels : uint8 array of shape [H, W, 3]
        valid : bool array of shape [H, W], optional
            Pixels that count; all by default.
        by_features : float32 array of shape [H, W, C], optional
            Gradient of a further loss with respect to the blended features; zero by default.
        view : int
            Row of the exposures. Pictures of one photo at several sizes share it.

        Raises
        ------
        CameraError
            If the camera cannot be rendered.
        ValueError
            If shapes or types do not match, no pixel is valid, or there is no such view.
        """
        check_camera(camera)
        if pixels.dtype != np.uint8 or pixels.shape != (camera.height, camera.width, 3):
            raise ValueError(
                f"a photo is uint8 of shape {(camera.height, camera.width, 3)}, got {pixels.dtype} {pixels.shape}"
            )
        shape = (camera.height, camera.width, self.parameters.n_features)
        if by_features is not None and by_features.shape != shape:
            raise ValueError(f"`by_features` must have shape {shape}, got {by_features.shape}")
        if not 0 <= view < self.exposures.n:
            raise ValueError(f"there are exposures of {self.exposures.n} views, got view {view}")
        counts = valid_pixels(pixels.shape[:2], valid)
        packed = np.empty((*counts.shape, 4), np.uint8)
        for channel in range(3):  # one by one, NumPy copies several times as fast
            packed[..., channel] = pixels[..., channel]
        packed[..., 3] = np.where(counts, 255, 0)
        with translate_card_errors(self.gpu, "train with fewer or smaller photos, or use the CPU"):
            buffer = self.gpu.device.create_buffer_with_data(
                data=packed, usage=STORAGE, label=f"photo {self._n_photos}"
            )
            given = None
            if by_features is not None:
                data = np.ascontiguousarray(by_features, np.float32)
                given = self.gpu.device.create_buffer_with_data(data=data, usage=STORAGE, label="by_features")
        number, self._n_photos = self._n_photos, self._n_photos + 1
        values = camera_values(camera, self.settings.raster)
        self._photos[number] = Photo(camera, values, buffer, int(counts.sum()), given, view)
        return number

    def free_photo(self, number: int) -> None:
        """Free the memory of a photo, which is not used again."""
        photo = self._photos.pop(number)
        if photo.by_features is not None:
            for frame in self._frames.values():
                frame.forget(photo.by_features)

    def mask_photo(self, number: int, valid: NDArray[np.bool_] | None) -> None:
        """Set the pixels of a photo that count from the next step on, for example all but those of transients.

        Parameters
        ----------
        number : int
            Result of `add_photo`.
        valid : bool array of shape [H, W], or None for all pixels

        Raises
        ------
        ValueError
            If the shape does not match, or no pixel is valid.
        """
        photo, queue = self._photos[number], self.gpu.device.queue
        shape = (photo.camera.height, photo.camera.width)
        counts = valid_pixels(shape, valid)
        with translate_card_errors(self.gpu, "use the CPU"):
            packed = np.frombuffer(queue.read_buffer(photo.pixels), np.uint8).reshape(*shape, 4).copy()
            packed[..., 3] = np.where(counts, 255, 0)
            queue.write_buffer(photo.pixels, 0, packed)
        self._photos[number] = replace(photo, n_valid=int(counts.sum()))

    def download(self) -> tuple[dict[str, torch.Tensor], dict[str, AdamState]]:
        """Return copies of values and moments by name, the types of the processor's trainer."""
        with translate_card_errors(self.gpu, "use the CPU"):
            values = {name: torch.from_numpy(value) for name, value in self.parameters.values().items()}
            return values, self.parameters.moments()

    def geometry(self) -> dict[str, torch.Tensor]:
        """Return copies of means [N, 3], quats [N, 4], log_scales [N, 3] and opacity_logits [N], float32."""
        with translate_card_errors(self.gpu, "use the CPU"):
            return {name: torch.from_numpy(value) for name, value in self.parameters.geometry().items()}

    def upload(
        self, values: Mapping[str, torch.Tensor], moments: Mapping[str, AdamState], *, n_background: int = 0
    ) -> None:
        """Replace the Gaussians, for example by those of a checkpoint; photos and exposures stay.

        Parameters
        ----------
        values, moments : mapping of str to tensor, and to AdamState
            As `download` returns them. There may be other Gaussians and fewer bands of harmonics, not other features.

        Raises
        ------
        ValueError
            If the number of features changes.
        EnvironmentProblem
            If the card's memory is full.
        """
        arrays = {name: np.ascontiguousarray(value.detach().numpy()) for name, value in values.items()}
        n_features = arrays["features"].shape[1] if "features" in arrays else 0
        if n_features != self.parameters.n_features:
            raise ValueError(f"the Gaussians have {self.parameters.n_features} features, got {n_features}")
        old = self.parameters
        room = self._room_for(len(arrays["means"]))
        # Frames are bound to the buffers of the parameters, which stay only if nothing is larger.
        if room > old.room or arrays.get("sh_rest", np.zeros((0, 0))).shape[1] + 1 != old.n_sh:
            self._free_frames()
        self.parameters = GpuParameters(
            self.gpu, arrays, moments, n_background=n_background, room=room, reuse=old.buffers
        )
        for frame in self._frames.values():
            frame.set_parameters(self.parameters)

    def rearrange(self, geometry: Mapping[str, torch.Tensor], sources: torch.Tensor, fresh: torch.Tensor) -> None:
        """Make M Gaussians of the N that there are: some moved, copied, or removed.

        Photos, exposures, the number of background Gaussians and Adam's numbers of steps stay.

        Parameters
        ----------
        geometry : mapping of str to tensor
            New values, float32: means [M, 3], quats [M, 4], log_scales [M, 3], opacity_logits [M].
        sources : int64 tensor of shape [M]
            Gaussians that harmonics, features and all moments are those of, 0 to N - 1.
        fresh : bool tensor of shape [M]
            Gaussians whose moments are zero.

        Raises
        ------
        ValueError
            If shapes or types do not match, or a source does not exist.
        EnvironmentProblem
            If the card's memory is full.
        """
        check_rearrangement(self.parameters, geometry, sources, fresh)
        parameters, m = self.parameters, len(sources)
        with translate_card_errors(self.gpu, "train fewer Gaussians, or use the CPU"):
            if m > parameters.room:
                self._free_frames()
                self._pool.clear()  # so that it is not in memory together with both the old and the new parameters
                parameters.reserve(self._room_for(m))
            Rearrangement(self.gpu, parameters, self._pool).run(sources.numpy(), fresh.numpy())
            for name, value in geometry.items():
                parameters.write(name, value.detach().numpy())
            parameters.n = m
            for frame in self._frames.values():
                frame.resize(m)

    def _room_for(self, n: int) -> int:
        """Return the room of buffers that hold `n` Gaussians: that of the present ones if it is enough."""
        return self.parameters.room if n <= self.parameters.room else int(_HEADROOM * n)

    def _free_frames(self) -> None:
        for frame in self._frames.values():
            frame.release()
        self._frames.clear()

    def steps(self, plans: Iterable[StepPlan]) -> list[float]:
        """Make training steps and return their losses, with all terms but that which `by_features` is the gradient of.

        Plans are taken while earlier ones are on the card already.

        A step with a gradient that is not finite is refused: it changes nothing but by the random walk and the limits.

        Raises
        ------
        NumericalError
            If a parameter, the image or the loss is not finite, or after 20 refused steps in total: no step was made
            from that one on.
        EnvironmentProblem
            If the card's memory is full, or the card stops working.
        ValueError
            If a plan samples pixels outside of its photo or Gaussians that there are not, or has a loss of features
            that the Gaussians do not have.
        """
        losses: list[float] = []
        ahead, again = iter(plans), list[StepPlan]()
        with translate_card_errors(self.gpu, "train fewer Gaussians, or use the CPU"):
            while True:
                queued, made = self._batch(itertools.islice(itertools.chain(again, ahead), _BATCH))
                if not queued:
                    return losses
                losses += made
                again = queued[len(made) :]

    def gaussian_errors(self, photos: Sequence[int], sh_degree: int) -> torch.Tensor:
        """Return the error of the pictures in the pixels of each Gaussian, summed over `photos`, float32 [N].

        ``v_g = sum over valid pixels of w_g mean|image - photo|`` with w_g the blending weight, without dropout and
        exposures.

        Parameters
        ----------
        photos : sequence of int
            Results of `add_photo`.
        sh_degree : int
            Highest band of spherical harmonics.

        Raises
        ------
        NumericalError
            If a parameter or an image is not finite.
        EnvironmentProblem
            If the card's memory is full, or the card stops working.
        """
        if not photos:
            return torch.zeros(self.parameters.n)
        with translate_card_errors(self.gpu, "train fewer Gaussians, or use the CPU"):
            while True:
                self._clear_status()
                for place, number in enumerate(photos):
                    photo = self._photos[number]
                    frame = self._picture_frame(photo.camera, sh_degree)
                    frame.add_errors(photo.pixels, zeroed=place == 0)
                halted, _, wanted = (int(value) for value in self._read_status()[:3])
                if not halted:
                    return torch.from_numpy(frame.read("errors", (self.parameters.n,)))
                self._grow_or_raise(halted, wanted)

    def render(self, camera: PinholeCamera, sh_degree: int) -> NDArray[np.float32]:
        """Return a picture of the Gaussians over black, float32 [H, W, 3]; errors as of `gaussian_errors`."""
        with translate_card_errors(self.gpu, "train fewer Gaussians, or use the CPU"):
            while True:
                self._clear_status()
                frame = self._picture_frame(camera, sh_degree)
                frame.render()
                counts = frame.counts()
                if counts.not_finite & _INPUT_NOT_FINITE:
                    raise_fault(_INPUT_NOT_FINITE, self.parameters)
                if counts.n_wanted <= self._capacity:
                    return frame.read("image", (camera.height, camera.width, 3))
                self._grow_or_raise(_TOO_MANY_PAIRS, counts.n_wanted)

    def _picture_frame(self, camera: PinholeCamera, sh_degree: int) -> TrainingFrame:
        """Return the frame of a camera, set for a picture of all Gaussians without a step."""
        frame = self._frame(camera, with_features=False)
        frame.set_view(camera, self.settings.raster, sh_degree)
        groups = np.zeros((len(_GROUPS), 4), np.float32)
        frame.set_optimiser(0, PhotoLoss(None, 1, 0.0), self.settings.unit_features, groups)
        return frame

    def nearest_neighbours(self, k: int) -> torch.Tensor:
        """Return the `k` nearest other Gaussians of each, the nearest first, int32 [N, k].

        With k other Gaussians or fewer, all of them, repeated.

        Raises
        ------
        ValueError
            If there is one Gaussian, or `k` is not from 1 to 64.
        EnvironmentProblem
            If the card's memory is full, or the card stops working.
        """
        n = self.parameters.n
        if n < 2 or not 1 <= k <= MAX_CHANNELS:
            raise ValueError(f"two Gaussians and more have 1 to {MAX_CHANNELS} neighbours, got {n} and {k}")
        with translate_card_errors(self.gpu, "train fewer Gaussians, or use the CPU"):
            found = NearestSearch(self.gpu, self.parameters, self._pool, min(k, n - 1)).run()
        return torch.from_numpy(np.ascontiguousarray(found[:, np.arange(k) % found.shape[1]]))

    def _clear_status(self) -> None:
        self.gpu.device.queue.write_buffer(self._status, 0, np.zeros(_LOSSES + _BATCH, np.uint32))

    def _read_status(self) -> NDArray[np.uint32]:
        return np.frombuffer(self.gpu.device.queue.read_buffer(self._status), np.uint32)

    def _batch(self, plans: Iterable[StepPlan]) -> tuple[list[StepPlan], list[float]]:
        """Queue steps; return them, and the losses of those that were made or refused, up to the first refused one.

        Grow the buffers, or raise, where one was not made for another reason.
        """
        self._clear_status()
        counted: Counter[str] = Counter()
        queued: list[StepPlan] = []
        for plan in plans:
            self._check(plan)
            counted.update([*self._trained(plan), *([_EXPOSURE] if plan.exposure_rate is not None else [])])
            self._queue(plan, len(queued), counted)
            queued.append(plan)
        if not queued:
            return [], []
        status = self._read_status()
        halted, made, wanted = (int(value) for value in status[:3])
        self.guards.update(dict(zip(GUARDS, (int(n) for n in status[3:_LOSSES]), strict=True)))
        for plan in queued[:made]:
            for name in self._trained(plan):
                self.parameters.steps[name] += 1
            self.exposures.step += plan.exposure_rate is not None
        losses = status[_LOSSES:].view(np.float32)
        if is_refusal(halted) and self.guards[REFUSED_STEPS] < MAX_REFUSED_STEPS:
            self.guards[REFUSED_STEPS] += 1
            return queued, [float(loss) for loss in losses[: made + 1]]
        if halted:
            self._grow_or_raise(halted, wanted)
        return queued, [float(loss) for loss in losses[:made]]

    def _grow_or_raise(self, halted: int, wanted: int) -> None:
        """Make the buffers hold `wanted` pairs if there were too many, otherwise raise why no step was made."""
        if halted != _TOO_MANY_PAIRS:
            raise_fault(halted, self.parameters)
        self._free_frames()
        self._capacity = grown_capacity(wanted, self.parameters.n)

    def _check(self, plan: StepPlan) -> None:
        """Raise ValueError if a plan cannot be carried out: kernels do not check their indices."""
        camera = self._photos[plan.photo].camera
        uses_features = plan.lambda_ray > 0 or any(sample.needs_features for sample in plan.terms)
        if uses_features and not self.parameters.n_features:
            raise ValueError("the plan has a loss of features, and the Gaussians have none")
        for sample in plan.terms:
            sample.check(camera, self.parameters.n)

    def _trained(self, plan: StepPlan) -> list[str]:
        """Return the groups that a step changes."""
        return [
            name
            for name in self.parameters.names
            if name in plan.learning_rates and (plan.sh_degree or name != "sh_rest")
        ]

    def _queue(self, plan: StepPlan, index: int, queued: Mapping[str, int]) -> None:
        """Queue one step. `queued` counts the steps of each group since the status was cleared, with this one."""
        photo, settings = self._photos[plan.photo], self.settings
        frame = self._frame(photo.camera, with_features="features" in plan.learning_rates)
        frame.set_camera_values(photo.camera_values, plan.sh_degree)
        shared = functools.partial(TrainingWorkspace, self.gpu, shared=self.parameters.buffers, pool=self._pool)
        terms = [sample.found(shared, self.parameters.room) for sample in plan.terms]
        loss = PhotoLoss(
            photo.pixels, photo.n_valid, settings.lambda_dssim, photo.by_features, photo.view, settings.lambda_exposure,
            plan.lambda_opacity, settings.lambda_scale, plan.lambda_ray, settings.detached_features,
            plan.dropout, terms,
        )  # fmt: skip
        frame.set_photo(loss)
        self.exposures.use(plan.centred)
        frame.set_noise(plan.noise)
        self._set_optimiser(frame, plan, loss, index, queued)
        frame.step()

    def _set_optimiser(
        self, frame: TrainingFrame, plan: StepPlan, loss: PhotoLoss, index: int, queued: Mapping[str, int]
    ) -> None:
        """Set the constants of Adam for one step; the rest as of `_queue`."""
        rates = {name: (plan.learning_rates[name], self.parameters.steps[name]) for name in self._trained(plan)}
        if plan.exposure_rate is not None:
            rates[_EXPOSURE] = plan.exposure_rate, self.exposures.step
        groups = np.zeros((len(_GROUPS), 4), np.float32)
        for name, (rate, done) in rates.items():
            t = done + queued[name]
            root_correction = 1.0 / math.sqrt(1.0 - BETAS[1] ** t)
            groups[_GROUPS.index(name)] = rate / (1.0 - BETAS[0] ** t), root_correction, 1.0, LARGEST_STEP * rate
        frame.set_optimiser(index, loss, self.settings.unit_features, groups, with_limits=plan.limits)

    def _frame(self, camera: PinholeCamera, *, with_features: bool = True) -> TrainingFrame:
        """Return the frame of a size of picture, which blends features only if they are trained in the step.

        The largest is made first, so that its buffers fit all.
        """
        with_features = with_features and self.parameters.n_features > 0
        if not self._frames:
            cameras = [camera, *(photo.camera for photo in self._photos.values())]
            largest = max(cameras, key=lambda one: one.width * one.height)
            self._make_frame(largest, with_features=self.parameters.n_features > 0)
        if (camera.width, camera.height, with_features) not in self._frames:
            self._make_frame(camera, with_features=with_features)
        return self._frames[camera.width, camera.height, with_features]

    def _make_frame(self, camera: PinholeCamera, *, with_features: bool) -> None:
        parameters, width, height = self.parameters, camera.width, camera.height
        n_features = parameters.n_features if with_features else 0
        size = FrameSize(parameters.n, parameters.n_sh, n_features, width, height, self._capacity, room=parameters.room)
        n_moving = 3 if self.settings.detached_features else None
        self._frames[width, height, with_features] = TrainingFrame(
            self.gpu, size, parameters, self.exposures, self._status, self._pool, timings=self._timings,
            n_moving=n_moving, limits=self.settings.limits,
        )  # fmt: skip
