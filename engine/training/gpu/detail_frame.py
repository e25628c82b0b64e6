"""A frame with the buffers and dispatches of a step of detail: two pictures, within the scene and alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float32
from ...rasterizer.gpu import Dispatch, FrameSize, Gpu, Timings, run_together, sh_bytes
from ...scene import PinholeCamera
from ..detail_crops import DetailCrop
from ..detail_rules import ALONE_WEIGHT, COVERAGE_WEIGHT, KEPT_WEIGHT
from ..losses import GpuExposures
from ..settings import LAMBDA_DSSIM
from .parameters import GpuParameters
from .training_frame import PhotoLoss, TrainingFrame

_ALIGNED = 64
"""Values at whose multiples a part of a buffer may begin."""

_KNOWN, _KEPT = np.uint32(1 << 16), np.uint32(1 << 17)  # as in coverage_gradient.wgsl


@dataclass(frozen=True)
class Window:
    """What a step compares, as the card reads it, in the corner of a picture that may be larger.

    Attributes
    ----------
    camera : PinholeCamera
        Of the whole picture, [H, W].
    targets : array of shape [3, H W, rounded up], uint32
        Red, green and blue with 255 where pixels are compared within the scene; the same alone; and the coverage.
    counts : tuple of 4 int
        Pixels that are compared within the scene, inside, known, and kept.
    view : int
        Row of the exposures.
    """

    camera: PinholeCamera
    targets: NDArray[np.uint32]
    counts: tuple[int, int, int, int]
    view: int


def packed_window(crop: DetailCrop, camera: PinholeCamera, view: int) -> Window:
    """Return a crop as a window of the picture of `camera`, whose first pixels are those of the crop."""
    height, width = crop.shape
    targets = np.zeros((3, _stride(camera.width * camera.height)), np.uint32)
    whole = targets[:, : camera.width * camera.height].reshape(3, camera.height, camera.width)
    parts, colors = whole[:, :height, :width], cv2.split(crop.pixels)
    for part, counted in zip(parts, (crop.compared, crop.inside), strict=False):
        part[:] = cv2.merge([*colors, counted.view(np.uint8) * np.uint8(255)]).view("<u4")[..., 0]
    kept = crop.shown & ~crop.inside
    flags = crop.known.astype(np.uint32) * _KNOWN | kept.astype(np.uint32) * _KEPT
    np.bitwise_or(np.rint(np.clip(crop.alpha, 0, 1) * 65535).astype(np.uint32), flags, out=parts[2])
    counts = tuple(int(np.count_nonzero(mask)) for mask in (crop.compared, crop.inside, crop.known, kept))
    return Window(camera, targets, counts, view)  # type: ignore[arg-type]


def _stride(n: int) -> int:
    return -(-n // _ALIGNED) * _ALIGNED


class DetailFrame(TrainingFrame):
    """Buffers of steps of detail with pictures of one size.

    The first `n_background` Gaussians of the parameters are the rest of the scene, which the second picture of a step
    leaves out.

    Parameters
    ----------
    gpu, size, parameters, exposures, status, pool, timings
        As of `TrainingFrame`.
    limits : float32 array of shape [12]
        See object_limits.wgsl.
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
        limits: Float32,
        timings: Timings | None = None,
    ) -> None:
        self._object_limits = limits
        super().__init__(gpu, size, parameters, exposures, status, pool, timings=timings)
        n_bytes = 4 * size.width * size.height
        scene, alone, cover = (("targets", 4 * i * _stride(size.width * size.height), n_bytes) for i in range(3))
        self._alone_uniform, self._coverage_uniform = self._uniform(64), self._uniform(16)
        names: list[str | tuple[str, int, int]] = ["transmittance", cover, "gradient"]
        coverage = self._step("loss", "coverage_gradient", self._coverage_uniform, names, -(-n_bytes // 1024))
        hide = self._step(
            "activations", "hide_background", self._optimisers[0][0], ["geometry"], -(-parameters.n_background // 128)
        )
        # The last step of a loss is the gradient of the brightness, which is not trained.
        self._loss_in_scene = self._submissions(self._loss_steps(self._loss_uniform, scene)[:-1])
        loss_alone = self._loss_steps(self._alone_uniform, alone)[:-1]
        # The second picture takes the lists of the first one.
        self._alone = self._submissions([hide, self._blend_step(), *loss_alone, coverage])
        self._keep = self._submissions(self._keep_steps(adds=False))
        self._add = self._submissions(self._keep_steps(adds=True))

    def _sizes(self) -> dict[str, int]:
        s = self.size
        return super()._sizes() | {
            "targets": 12 * _stride(s.width * s.height), "kept_rows": 48 * s.n_room,
            "kept_sh": sh_bytes(s.n_room, s.n_sh),
        }  # fmt: skip

    def _keep_steps(self, *, adds: bool) -> list[Dispatch]:
        """Return the dispatches that keep the gradients of the first picture, or add them to those of the second."""
        rows = self._constants(3 * self.size.n_room, adds)
        names: list[str | tuple[str, int, int]] = ["gradients", "kept_rows"]
        steps = [self._step("sums", "keep_values", rows, names, self._over(128, 3))]
        for _, _, at, n_bytes in self._color_ranges():
            part = [("sh_gradient", at, n_bytes), ("kept_sh", at, n_bytes)]
            groups = -(-n_bytes // (16 * 128))
            steps.append(self._step("sums", "keep_values", self._constants(n_bytes // 16, adds), part, groups))
        return steps

    def _last_steps(self, optimiser: Any) -> list[Dispatch]:
        data = np.ascontiguousarray(self._object_limits, np.float32)
        limits = {"buffer": self.gpu.device.create_buffer_with_data(data=data, usage=0x40), "offset": 0, "size": 48}
        self.buffers["object_limits"] = limits["buffer"]
        names = ["means", "quats", "log_scales", "opacity_logits", "skipped"]
        return [self._step("limits", "object_limits", optimiser, ["object_limits", *names], self._over(128))]

    def set_window(self, window: Window) -> None:
        """Set what the next step compares, and the weights of the losses."""
        n_compared, n_inside, n_known, n_kept = window.counts
        self.write("targets", window.targets)
        within = PhotoLoss(None, n_compared, LAMBDA_DSSIM, view=window.view)
        self._loss_uniform.write(self._loss_values(within))
        alone = self._loss_values(PhotoLoss(None, n_inside, LAMBDA_DSSIM, view=window.view))
        weights = alone.view(np.float32)
        weights[4:6] *= np.float32(ALONE_WEIGHT)
        self._alone_uniform.write(alone)
        values = np.zeros(4, np.uint32)
        values[0] = self.size.width * self.size.height
        by = COVERAGE_WEIGHT / max(n_known, 1), KEPT_WEIGHT / max(n_kept, 1) if n_known else 0.0
        values[1:3] = np.array(by, np.float32).view(np.uint32)
        self._coverage_uniform.write(values)

    def step(self) -> None:
        """Queue one step."""
        runs = [
            self._activate, self._forward, self._loss_in_scene, self._backward, self._keep,
            self._alone, self._backward, self._add, self._finish,
        ]  # fmt: skip
        self.start_counts()
        run_together(self.gpu, runs, zeroed=[self.buffers[name] for name in ("tile_ranges", "skipped")])
