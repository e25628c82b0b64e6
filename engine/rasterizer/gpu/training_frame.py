"""A frame with the buffers and dispatches of a whole training step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .adapters import Gpu
from .exposure import GpuExposures
from .frame import Frame
from .layout import FrameSize
from .parameters import GROUPS, GpuParameters
from .submissions import Submissions

__all__ = ["TrainingFrame"]

_GRADIENT_NOT_FINITE = 8  # as in verdict.wgsl


class TrainingFrame(Frame):
    """Buffers of training steps with pictures of one size.

    Parameters
    ----------
    gpu : Gpu
    size : FrameSize
    parameters : GpuParameters
    exposures : GpuExposures
    status : wgpu.GPUBuffer
        See optimiser.wgsl.
    scratch : mapping of str to wgpu.GPUBuffer
        The `scratch` of a frame of the same parameters, whose steps do not overlap those of this one.
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
        scratch: Mapping[str, Any],
        *,
        n_moving: int | None = None,
    ) -> None:
        super().__init__(gpu, size, n_moving=n_moving, shared={**scratch, **parameters.buffers})
        n_pixels = size.width * size.height
        self.allocate({"maps": 36 * n_pixels, "partial_sums": 8 * size.n_tiles, "loss_values": 16})
        self.allocate({"exposure_sums": 16 * size.n_tiles, "exposure_gradient": 16})
        self.buffers |= parameters.buffers | exposures.buffers | {"status": status}
        self._parameters, self._exposures = parameters, exposures
        self._loss_uniform = self._uniform(32)
        self._optimisers: list[tuple[Any, int]] = []
        self._photos: dict[int, Submissions] = {}
        self._given: Any = None
        optimiser = self._optimiser_uniform(0)
        activate = self._step(
            "activations", "activate", optimiser,
            ["log_scales", "opacity_logits", "features", "scales", "opacities", "channels", "status"], -(-size.n // 128),
        )  # fmt: skip
        self._activate = self._submissions([activate])
        self._finish = self._submissions(self._finish_steps(optimiser))

    @property
    def scratch(self) -> dict[str, Any]:
        """The buffers that hold nothing from one step to the next."""
        kept = {"gradient", "photo", "status", "dispatches", *self._parameters.buffers, *self._exposures.buffers}
        return {name: buffer for name, buffer in self.buffers.items() if name not in kept}

    def _optimiser_uniform(self, first: int) -> Any:
        buffer = self._uniform(64 + 16 * (len(GROUPS) + 1))
        self._optimisers.append((buffer, first))
        return buffer

    def _finish_steps(self, optimiser: Any) -> list[Any]:
        """Return the dispatches after the backward pass: tests, verdict, Adam."""
        s = self.size
        steps = []
        for name in ("gradients", "totals"):
            steps.append(self._find_not_finite(name, 0, self.buffers[name].size))
        for _, _, at, n_bytes in self._color_ranges():
            steps.append(self._find_not_finite("sh_gradient", at, n_bytes))
        steps.append(self._step("verdict", "verdict", optimiser, ["counts", "loss_values", "status"], 1))
        names = ["gradients", "means", "quats", "log_scales", "opacity_logits", "rows_mean", "rows_square", "status"]
        steps.append(self._step("adam", "adam_rows", optimiser, names, -(-12 * s.n // 128)))
        for first, _, at, n_bytes in self._color_ranges():
            uniform = self._optimiser_uniform(first) if first else optimiser
            slices = [(name, at, n_bytes) for name in ("sh_gradient", "sh", "sh_mean", "sh_square")]
            steps.append(self._step("adam", "adam_sh", uniform, [*slices, "status"], -(-n_bytes // 512)))
        if s.n_channels:
            names = ["totals", "channels", "features", "features_mean", "features_square", "status"]
            steps.append(self._step("adam", "adam_channels", optimiser, names, -(-s.n // 128)))
        names = ["exposure_gradient", "exposure", "exposure_mean", "exposure_square", "in_use", "status"]
        steps.append(self._step("adam", "adam_exposure", optimiser, names, 1))
        return steps

    def _find_not_finite(self, name: str, at: int, n_bytes: int) -> Any:
        settings = self._constants(n_bytes // 16, _GRADIENT_NOT_FINITE)
        return self._step("tests", "find_not_finite", settings, [(name, at, n_bytes), "counts"], -(-n_bytes // 2048))

    def set_photo(
        self,
        pixels: Any,
        n_valid: int,
        by_features: NDArray[np.float32] | None,
        *,
        lambda_dssim: float,
        view: int = 0,
        lambda_exposure: float = 0.0,
    ) -> None:
        """Set the photo of the next steps.

        Parameters
        ----------
        pixels : wgpu.GPUBuffer
            uint8 [H, W, 4]: red, green, blue, and 0 where the pixel does not count.
        n_valid : int
            Number of pixels that count.
        by_features : float32 array of shape [H, W, C], optional
            Gradient of the channels after the colours.
        lambda_dssim : float
        view : int
            Row of the exposures that the image is multiplied by.
        lambda_exposure : float
            Weight of the sum of that row's squares.
        """
        s = self.size
        values = np.zeros(8, np.uint32)
        values[:3] = s.width, s.height, s.n_tiles
        values[3:6] = np.array([1.0 / (3 * n_valid), lambda_dssim, 1.0 - lambda_dssim], np.float32).view(np.uint32)
        values[6], values[7] = view, np.float32(lambda_exposure).view(np.uint32)
        self.gpu.device.queue.write_buffer(self._loss_uniform, 0, values)
        if by_features is not self._given:
            gradient = np.zeros((s.height, s.width, s.n_out + 1), np.float32)
            if by_features is not None:
                gradient[..., 3:-1] = by_features
            self.write("gradient", gradient)
            self._given = by_features
        self._loss = self._loss_of(pixels)

    def _loss_of(self, pixels: Any) -> Submissions:
        """Return the dispatches of the loss with a photo."""
        if id(pixels) not in self._photos:
            self.buffers["photo"] = pixels
            n, loss = self.size.n_tiles, self._loss_uniform
            steps = [
                self._step("loss", "similarity", loss, ["image", "photo", "maps", "partial_sums", "exposure"], n),
                self._step("loss", "loss_total", loss, ["partial_sums", "loss_values", "counts", "exposure"], 1),
                self._step(
                    "loss",
                    "loss_gradient",
                    loss,
                    ["image", "photo", "maps", "gradient", "exposure", "exposure_sums"],
                    n,
                ),
                self._step(
                    "loss", "exposure_gradient", loss, ["exposure", "exposure_sums", "exposure_gradient", "counts"], 1
                ),
            ]
            self._photos[id(pixels)] = self._submissions(steps)
        return self._photos[id(pixels)]

    def set_optimiser(
        self, index: int, view: int, unit_features: bool, factors: NDArray[np.float32], groups: NDArray[np.float32]
    ) -> None:
        """Set the constants of the next step.

        Parameters
        ----------
        index : int
            Number of the step since the status was cleared.
        view : int
            Row of the exposures that it has a gradient of.
        unit_features : bool
        factors : float32 array of shape [5]
            beta1, beta2, 1 - beta1, 1 - beta2, eps.
        groups : float32 array of shape [8, 4]
            For each of `GROUPS` and the exposures: step size, root of the correction of the square, 1 if it is trained.
        """
        s = self.size
        for buffer, first in self._optimisers:
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
                factors.view(np.uint32),
                np.array([view, self._exposures.n, 0], np.uint32),
                groups.view(np.uint32).reshape(-1),
            ]
            self.gpu.device.queue.write_buffer(buffer, 0, np.concatenate(values))

    def step(self) -> None:
        """Queue one step."""
        self._submit(self._activate, [])
        self.forward()
        self._submit(self._loss, [])
        self.backward()
        self._submit(self._finish, [])
