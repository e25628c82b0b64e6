"""A frame with the buffers and dispatches of a whole training step."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...rasterizer.gpu import BLOCK, Dispatch, Frame, FrameSize, Gpu, Submissions, Timings, Uniform, run_together
from ..adam import BETAS, EPS
from ..losses import CardLoss, GpuExposures, Sample
from .errors import ErrorSum
from .parameters import GROUPS, GpuParameters
from .settings import StepLimits
from .workspace import TrainingWorkspace

_GRADIENT_NOT_FINITE = 8  # as in verdict.wgsl

_ADAM = np.array([*BETAS, 1.0 - BETAS[0], 1.0 - BETAS[1], EPS], np.float32)  # as in optimiser.wgsl


_NOISE = 5
"""Purpose of the random draws, as in the processor's trainer: one draw for each seed, step, purpose and Gaussian."""


@dataclass(frozen=True)
class Dropout:
    """Gaussians left out of the picture of one step; the opacities of the others are raised to make up for them.

    Attributes
    ----------
    fraction : float
        Share that is left out, 0 to below 1.
    max_opacity : float
        Largest opacity that the others get.
    seed, step : int
        Keys of the draws, 0 to 2^32 - 1.
    """

    fraction: float
    max_opacity: float
    seed: int
    step: int

    def __post_init__(self) -> None:
        if not 0.0 <= self.fraction < 1.0:
            raise ValueError(f"a share of Gaussians is at least 0 and below 1, got {self.fraction}")


@dataclass(frozen=True)
class PositionNoise:
    """Random walk of nearly transparent Gaussians after a step.

    Attributes
    ----------
    amount : float
        Factor of the covariance, per world unit: learning rate of positions per extent, times strength, over extent.
    max_walk : float
        Largest distance along each axis, in scales.
    seed, step : int
        Keys of the draws, 0 to 2^32 - 1.
    """

    amount: float
    max_walk: float
    seed: int
    step: int


@dataclass(frozen=True)
class PhotoLoss:
    """A photo, and the loss of a step.

    Attributes
    ----------
    pixels : wgpu.GPUBuffer
        uint8 [H, W, 4]: red, green, blue, and 0 where the pixel does not count.
    n_valid : int
        Number of pixels that count.
    lambda_dssim : float
    given : wgpu.GPUBuffer, optional
        float32 [H, W, C]: gradient of a further loss by the channels after the colours.
    view : int
        Row of the exposures that the image is multiplied by.
    lambda_exposure : float
        Weight of the sum of that row's squares.
    lambda_opacity, lambda_scale : float
        Weights of the mean opacity and of the mean scale.
    lambda_ray : float
        Weight of the disagreement of unit features along rays.
    detached : bool
        Whether that changes no transmittance.
    dropout : Dropout, optional
    terms : sequence of Sample
        What further losses are evaluated on.
    """

    pixels: Any
    n_valid: int
    lambda_dssim: float
    given: Any = None
    view: int = 0
    lambda_exposure: float = 0.0
    lambda_opacity: float = 0.0
    lambda_scale: float = 0.0
    lambda_ray: float = 0.0
    detached: bool = False
    dropout: Dropout | None = None
    terms: Sequence[Sample] = ()


class TrainingFrame(TrainingWorkspace, Frame):
    """Buffers of training steps with pictures of one size.

    Parameters
    ----------
    status : wgpu.GPUBuffer
        See optimiser.wgsl.
    pool : dict of str to wgpu.GPUBuffer
        See `Workspace`; that of frames whose steps do not overlap those of this one.
    n_moving : int, optional
        See `Frame`.

    Raises
    ------
    EnvironmentProblem
        If a buffer is larger than a kernel of this card can see, or memory is full.
    """

    def __init__(
        self,
        gpu: Gpu,
        size: FrameSize,
        parameters: GpuParameters,
        exposures: GpuExposures,
        status: Any,
        pool: dict[str, Any],
        *,
        timings: Timings | None = None,
        n_moving: int | None = None,
        limits: StepLimits | None = None,
    ) -> None:
        super().__init__(gpu, size, n_moving=n_moving, shared=parameters.buffers, pool=pool, timings=timings)
        self.buffers |= parameters.buffers | exposures.buffers | {"status": status}
        self._parameters, self._exposures, self._limits = parameters, exposures, limits
        self._loss_uniform = self._uniform(64)
        self._optimisers: list[tuple[Uniform, int]] = []
        self._tests: list[tuple[Uniform, int]] = []
        self._losses: dict[int, Submissions] = {}
        optimiser = self._optimiser_uniform(0)
        names = ["log_scales", "opacity_logits", "scales", "opacities", "status", "gaussian_sums"]
        activate = [self._step("activations", "activate", optimiser, names, self._over(256))]
        if size.n_channels:
            names = ["features", "channels", "status"]
            activate.append(self._step("activations", "activate_channels", optimiser, names, self._over(16)))
        self._noise_uniform = self._uniform(32)
        self._terms: dict[type[Sample], CardLoss] = {}
        self._errors = ErrorSum(self, optimiser)
        self._activate = self._submissions(activate)
        self._finish = self._submissions(self._finish_steps(optimiser))
        self._write_tests()

    def _sizes(self) -> dict[str, int]:
        s = self.size
        return super()._sizes() | {
            "photo": 4 * s.width * s.height, "maps": 36 * s.width * s.height, "partial_sums": 8 * s.n_tiles,
            "loss_values": 16,
            "exposure_sums": 16 * s.n_tiles, "exposure_gradient": 16, "ray_sums": 8 * s.n_tiles,
            "gaussian_sums": 8 * -(-s.n_room // 256), "skipped": 4 * (s.n_room + 1), "nothing": 16,
            "errors": 4 * s.n_room, "feature_scales": 8 * s.n_room if s.n_channels else 16,
        }  # fmt: skip

    def set_parameters(self, parameters: GpuParameters) -> None:
        """Continue with other Gaussians in the same buffers."""
        self._parameters = parameters
        self.resize(parameters.n)

    def resize(self, n: int) -> None:
        super().resize(n)
        self._write_tests()

    def _write_tests(self) -> None:
        for uniform, fours in self._tests:
            uniform.write(np.array([fours * self.size.n, _GRADIENT_NOT_FINITE], np.uint32))

    def _optimiser_uniform(self, first: int) -> Uniform:
        uniform = self._uniform(128 + 16 * (len(GROUPS) + 1))
        self._optimisers.append((uniform, first))
        return uniform

    def _finish_steps(self, optimiser: Any) -> list[Any]:
        """Return the dispatches after the backward pass: tests, verdict, Adam, noise, limits."""
        s = self.size
        chunks = -(-s.n_out // 4)
        steps = [self._find_not_finite("gradients", 3), self._find_not_finite("totals", chunks + 2)]
        names = ["gradients", "log_scales", "opacity_logits", "totals", "channels", "features", "skipped"]
        names.append("feature_scales")
        steps.append(self._step("tests", "find_overflow", optimiser, names, self._over(16)))
        uniforms = {first: self._optimiser_uniform(first) if first else optimiser for first, *_ in self._color_ranges()}
        steps += self._sh_steps("tests", "find_sh_overflow", uniforms, ["sh_gradient"], ["skipped", "counts"])
        steps.append(self._step("verdict", "verdict", optimiser, ["counts", "loss_values", "status", "skipped"], 1))
        names = ["gradients", "means", "quats", "log_scales", "opacity_logits", "rows_mean", "rows_square", "skipped"]
        steps.append(self._step("adam", "adam_rows", optimiser, names, self._over(128, 12)))
        names = ["sh_gradient", "sh", "sh_mean", "sh_square"]
        steps += self._sh_steps("adam", "adam_sh", uniforms, names, ["skipped"])
        if s.n_channels:
            names = ["totals", "channels", "feature_scales", "features", "features_mean", "features_square", "skipped"]
            steps.append(self._step("adam", "adam_channels", optimiser, names, self._over(128, s.n_channels)))
        names = ["exposure_gradient", "exposure", "exposure_mean", "exposure_square", "in_use", "skipped"]
        steps.append(self._step("adam", "adam_exposure", optimiser, names, 1))
        return [*steps, *self._last_steps(optimiser)]

    def _last_steps(self, optimiser: Any) -> list[Dispatch]:
        """Return the dispatches after Adam's: noise, limits."""
        names = ["means", "quats", "log_scales", "opacity_logits", "skipped"]
        steps = [self._step("noise", "noise", self._noise_uniform, names, self._over(128))]
        if self._limits is not None:
            names = ["means", "quats", "log_scales", "opacity_logits", "skipped", "status"]
            steps.append(self._step("limits", "limits", optimiser, names, self._over(128)))
        return steps

    def _find_not_finite(self, name: str, fours: int) -> Dispatch:
        """Return the test of a buffer with so many vec4 for each Gaussian."""
        settings = self._uniform(16)
        self._tests.append((settings, fours))
        return self._step("tests", "find_not_finite", settings, [name, "counts"], self._over(128, fours))

    def _sh_steps(
        self, stage: str, kernel: str, uniforms: Mapping[int, Uniform], parts: Sequence[str], names: Sequence[str]
    ) -> list[Dispatch]:
        """Return the dispatches of a kernel over the values of harmonics, on all ranges of the buffers `parts`."""

        def groups(first: int, last: int) -> int:
            return -(-self._blocks_of(first, last) * BLOCK * 3 * self.size.n_sh // 128)

        return [
            self._step(
                stage, kernel, uniforms[first], [*((name, at, n_bytes) for name in parts), *names],
                functools.partial(groups, first, last),
            )
            for first, last, at, n_bytes in self._color_ranges()
        ]  # fmt: skip

    def set_photo(self, photo: PhotoLoss) -> None:
        """Set the photo of the next steps and the weights of the loss."""
        self._loss_uniform.write(self._loss_values(photo))
        self._loss = self._loss_of(photo.given)
        self._photo = photo

    def _loss_values(self, photo: PhotoLoss) -> NDArray[np.uint32]:
        """Return the constants of a loss, as in loss.wgsl."""
        s = self.size
        values = np.zeros(16, np.uint32)
        values[:3] = s.width, s.height, s.n_tiles
        factors = {
            3: 1.0 / (3 * photo.n_valid) if photo.n_valid else 0.0,
            4: photo.lambda_dssim,
            5: 1.0 - photo.lambda_dssim,
            7: photo.lambda_exposure,
            9: photo.lambda_opacity / s.n,
            10: photo.lambda_scale / (3 * s.n),
            11: photo.lambda_ray / (s.width * s.height),
        }
        values[list(factors)] = np.array(list(factors.values()), np.float32).view(np.uint32)
        values[6], values[8] = photo.view, -(-s.n // 256)
        values[12], values[13] = photo.detached, photo.given is not None
        return values

    def set_noise(self, noise: PositionNoise | None) -> None:
        """Set the random walk after the next step; None for no walk."""
        values = np.zeros(8, np.uint32)
        values[0], values[3] = self.size.n, _NOISE
        if noise is not None:
            values[1:3] = noise.step, noise.seed
            values[4:6] = np.array([noise.amount, noise.max_walk], np.float32).view(np.uint32)
        self._noise_uniform.write(values)

    def _loss_of(self, given: Any) -> Submissions:
        """Return the dispatches of the loss, with a further one whose gradient is `given`."""
        key = id(given)
        if key not in self._losses:
            self.buffers["given"] = self.buffers["nothing"] if given is None else given
            self._losses[key] = self._submissions(self._loss_steps(self._loss_uniform, "photo"))
        return self._losses[key]

    def _loss_steps(self, loss: Uniform, photo: str | tuple[str, int, int]) -> list[Dispatch]:
        """Return the dispatches of a loss against the photo in a buffer or in a part of one."""
        n = self.size.n_tiles
        totals = ["partial_sums", "loss_values", "counts", "exposure", "gaussian_sums", "ray_sums"]
        steps = [
            self._step("loss", "similarity", loss, ["image", photo, "maps", "partial_sums", "exposure"], n),
            self._step("loss", "loss_total", loss, totals, 1),
            self._step(
                "loss", "loss_gradient", loss, ["image", photo, "maps", "gradient", "exposure", "exposure_sums"], n
            ),
            self._step(
                "loss", "exposure_gradient", loss, ["exposure", "exposure_sums", "exposure_gradient", "counts"], 1
            ),
        ]  # fmt: skip
        if self.size.n_channels:
            names = ["image", "transmittance", "given", "gradient", "ray_sums"]
            steps.insert(0, self._step("loss", "ray_gradient", loss, names, n))
        return steps

    def set_optimiser(
        self,
        index: int,
        photo: PhotoLoss,
        unit_features: bool,
        groups: NDArray[np.float32],
        *,
        with_limits: bool = True,
    ) -> None:
        """Set the constants of the next step.

        Parameters
        ----------
        index : int
            Number of the step since the status was cleared.
        groups : float32 array of shape [8, 4]
            For each of `GROUPS` and the exposures: step size, root of the correction of the square, 1 if it is trained,
            largest change.
        with_limits : bool
            Whether the limits are applied after it.
        """
        s = self.size
        for uniform, first in self._optimisers:
            integers = [
                s.n,
                self._parameters.n_background,
                s.n_sh,
                s.n_channels,
                unit_features,
                s.capacity,
                index,
                first,
            ]
            values = [
                np.array(integers, np.uint32),
                _ADAM.view(np.uint32),
                np.array([photo.view, self._exposures.n], np.uint32),
                self._limit_values(photo).view(np.uint32),
                _dropout_values(photo.dropout),
                np.array([with_limits, 0, 0], np.uint32),
                groups.view(np.uint32).reshape(-1),
            ]
            uniform.write(np.concatenate(values))

    def _limit_values(self, photo: PhotoLoss) -> NDArray[np.float32]:
        """Return the derivatives by each opacity and scale, and the limits, as in optimiser.wgsl; shape [10]."""
        values = np.zeros(10, np.float32)
        values[:2] = photo.lambda_opacity / self.size.n, photo.lambda_scale / (3 * self.size.n)
        if limits := self._limits:
            values[2:5], values[5] = limits.center, limits.max_distance
            values[6:9] = np.log([limits.max_scale, limits.min_scale, limits.max_aspect])
            values[9] = limits.max_logit
        return values

    def step(self) -> None:
        """Queue one step."""
        runs = [self._activate, self._forward, self._loss, *self._terms_of(before_backward=True)]
        runs += [self._backward, *self._terms_of(before_backward=False), self._finish]
        self.start_counts()
        zeroed = [self.buffers[name] for name in ("tile_ranges", "skipped")]
        run_together(self.gpu, runs, copies=[(self._photo.pixels, self.buffers["photo"])], zeroed=zeroed)

    def _terms_of(self, *, before_backward: bool) -> list[Submissions]:
        """Return the dispatches of the further losses of the step that are due before or after the backward pass."""
        due = [sample for sample in self._photo.terms if sample.before_backward == before_backward]
        for sample in due:
            if type(sample) not in self._terms:
                self._terms[type(sample)] = sample.loss_on(self)
        return [self._terms[type(sample)].prepared(sample) for sample in due]

    def render(self) -> None:
        """Queue a picture without a loss."""
        self._submit(self._activate, [])
        self.forward()

    def forget(self, given: Any) -> None:
        """Free what refers to the gradient of a further loss."""
        self._losses.pop(id(given), None)

    def add_errors(self, pixels: Any, *, zeroed: bool) -> None:
        """Queue a picture, and add its errors to the buffer ``errors``, which is `zeroed` before or not."""
        self._submit(self._activate, ["errors"] if zeroed else [])
        self.forward()
        self._errors.add(pixels)


def _dropout_values(dropout: Dropout | None) -> NDArray[np.uint32]:
    """Return the constants of dropout, as in optimiser.wgsl; shape [4]."""
    values = np.zeros(4, np.uint32)
    if dropout is not None:
        values[:2] = np.array([dropout.fraction, dropout.max_opacity], np.float32).view(np.uint32)
        values[2:] = dropout.seed, dropout.step
    return values
