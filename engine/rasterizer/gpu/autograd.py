"""The ``gpu`` backend of `engine.rasterizer.rasterize`: tensors on the CPU are copied to the card and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from ...core.errors import NumericalError
from ..raster import CulledCounts, Raster, RasterInputs, check_finite, input_tensors
from .adapters import Gpu, translate_card_errors
from .frame import Frame
from .layout import FrameSize, grown_capacity, pack_sh, unpack_sh

_NAMES = ("means", "quats", "scales", "opacities", "sh", "channels")


class _Rasterize(torch.autograd.Function):
    """Image and transmittance of a `Frame` whose forward pass has run; the first argument is the frame."""

    @staticmethod
    def forward(ctx: Any, frame: Frame, *tensors: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        ctx.frame = frame
        ctx.set_materialize_grads(True)
        s = frame.size
        image = frame.read("image", (s.height, s.width, s.n_out))
        return torch.from_numpy(image), torch.from_numpy(frame.read("transmittance", (s.height, s.width)))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_image: torch.Tensor, by_transmittance: torch.Tensor) -> Any:  # type: ignore[override]
        frame: Frame = ctx.frame
        s = frame.size
        frame.write("gradient", torch.cat([by_image, by_transmittance[..., None]], dim=2).numpy())
        frame.backward()
        if frame.counts().not_finite & 2:
            raise NumericalError("the gradient of the image is not finite; check the loss that produced it.")
        rows = frame.read("gradients", (s.n, 12))
        chunks = -(-s.n_out // 4)
        totals = frame.read("totals", (s.n, 4 * (chunks + 2)))
        by_sh = (
            unpack_sh(frame.read("sh_gradient", (-(-s.n // 64) * 64 * 3 * s.n_sh,)), s.n, s.n_sh) if s.n_sh else None
        )
        columns = [rows[:, :3], rows[:, 3:7], rows[:, 7:10], rows[:, 10], by_sh, totals[:, 8 + s.n_rgb : 8 + s.n_out]]
        gradients: list[torch.Tensor | None] = []
        for name, values in zip(_NAMES, columns, strict=True):
            gradient = torch.zeros(s.n, 0, 3) if values is None else torch.from_numpy(np.ascontiguousarray(values))
            check_finite(f"gradient of {name}", gradient)
            gradients.append(gradient)
        pose = None
        if ctx.needs_input_grad[7]:
            total = frame.read("pose", (s.n, 12)).sum(axis=0, dtype=np.float64)
            pose = torch.zeros(4, 4, dtype=torch.float64)
            pose[:3, :3], pose[:3, 3] = torch.from_numpy(total[:9].reshape(3, 3)), torch.from_numpy(total[9:])
            check_finite("gradient of viewmat", pose)
        return (None, *gradients, pose)


def rasterize_gpu(inputs: RasterInputs, gpu: Gpu) -> Raster:
    """Render as `engine.rasterizer.rasterize` describes, on `gpu`.

    Raises
    ------
    NumericalError
        If an input is not finite, or 2^31 pairs of a tile and a Gaussian or more are needed.
    EnvironmentProblem
        If the picture needs larger buffers than the card has, or the card stops working.
    ValueError
        If a tensor is not float32 on the CPU.
    """
    tensors = input_tensors(inputs, "gpu")
    arrays = dict(zip(_NAMES, (tensor.detach().contiguous().numpy() for tensor in tensors), strict=True))
    backward = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (*tensors, inputs.viewmat))
    with translate_card_errors(gpu, "use the CPU"):
        frame = _forward(inputs, gpu, arrays, backward)
        image, transmittance = _Rasterize.apply(frame, *tensors, inputs.viewmat.double())
        info = frame.read("info", (frame.size.n, 4), np.uint32)
    if not backward:
        frame.release()
    state = info[:, 0] & 7
    near, degenerate, transparent, outside = (int(np.count_nonzero(state == reason)) for reason in (1, 2, 3, 4))
    culled = CulledCounts(near, degenerate, transparent, outside)
    radii = np.where(state == 0, info[:, 1].view(np.float32), np.float32(0.0))
    return Raster(image, transmittance, torch.from_numpy(state == 0), torch.from_numpy(radii), culled)


def _forward(inputs: RasterInputs, gpu: Gpu, arrays: dict[str, Any], backward: bool) -> Frame:
    """Return a frame after its forward pass, grown until all pairs fit."""
    n, n_sh = arrays["sh"].shape[:2]
    n_moving = (3 if n_sh else 0) if inputs.detached_channels else None
    capacity = max(4096, 4 * n)
    while True:
        size = FrameSize(
            n, n_sh, arrays["channels"].shape[1], inputs.camera.width, inputs.camera.height, capacity, backward
        )
        frame = Frame(gpu, size, n_moving=n_moving, with_pose=inputs.viewmat.requires_grad)
        for name, values in arrays.items():
            frame.write(name, pack_sh(values) if name == "sh" else values)
        frame.set_view(inputs.camera, inputs.settings, inputs.sh_degree)
        frame.forward()
        counts = frame.counts()
        if counts.not_finite & 1:
            for name, values in arrays.items():
                check_finite(name, torch.from_numpy(values))
        if counts.n_wanted <= capacity:
            return frame
        frame.release()
        capacity = grown_capacity(counts.n_wanted, n)
