"""Assembly of the WGSL kernels for a number of channels, and their compilation.

A kernel is the text of its files, in order, after the constants of `engine.rasterizer.settings`. Two notations are
expanded, because WGSL has no loops at compile time:

- A line that ends with ``// each Q`` is repeated for each chunk of four channels, with ``_Q`` and ``Q_`` replaced by
  its number; ``// each C`` repeats for each channel, where ``_QC`` is the component that holds it, and ``// each P`` for
  each 32 columns of blend_backward.wgsl.
- Lines from ``//for G up`` or ``//for G down`` to ``//done`` are repeated for each Gaussian of a group in
  blend_backward.wgsl, with ``_G`` and ``G_`` replaced by its number.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files import read_text
from .. import settings
from ..loss_kernels import SSIM_C1, SSIM_C2, SSIM_WINDOW
from .adapters import Gpu
from .modules import create_module

__all__ = ["SCAN_BLOCK", "SORT_BLOCK", "Kernels", "backward_sizes", "kernel_source", "kernels_of"]

SORT_BLOCK = 2048
"""Keys that a workgroup sorts."""

SCAN_BLOCK = 1024
"""Values that a workgroup sums."""

KERNELS = {
    "project": ("ellipse", "tiles", "project"),
    "colors": ("sh", "colors"),
    "radix_count": ("radix", "radix_count"),
    "radix_scatter": ("radix", "radix_scatter"),
    "scan": ("scan",),
    "gather": ("gather",),
    "prepare": ("prepare",),
    "emit": ("tiles", "emit"),
    "lists": ("lists",),
    "blend": ("cover", "tile", "blend"),
    "blend_backward": ("cover", "blend_backward"),
    "sum_pairs": ("sum_pairs",),
    "sum_votes": ("sum_votes",),
    "project_backward": ("ellipse", "project_backward"),
    "colors_backward": ("sh", "colors_backward"),
    "similarity": ("loss", "window", "tree_sum", "similarity"),
    "loss_total": ("loss", "tree_sum", "loss_total"),
    "loss_gradient": ("loss", "window", "loss_gradient"),
    "exposure_gradient": ("loss", "tree_sum_4", "exposure_gradient"),
    "ray_gradient": ("loss", "tree_sum", "ray_gradient"),
    "clustering_units": ("clustering", "clustering_units"),
    "clustering_centers": ("clustering", "tree_sum_4", "clustering_centers"),
    "clustering_losses": ("clustering", "tree_sum_4", "clustering_logit", "clustering_losses"),
    "clustering_center_gradients": ("clustering", "tree_sum_4", "clustering_logit", "clustering_center_gradients"),
    "clustering_pixels": ("clustering", "clustering_pixels"),
    "clustering_total": ("clustering", "tree_sum_4", "clustering_total"),
    "neighbour_cosines": ("neighbours", "feature_length", "tree_sum_4", "neighbour_cosines"),
    "neighbour_total": ("neighbours", "tree_sum_4", "neighbour_total"),
    "neighbour_gradients": ("neighbours", "feature_length", "neighbour_gradients"),
    "activate": ("optimiser", "philox", "dropout", "tree_sum", "activate"),
    "activate_channels": ("optimiser", "activate_channels"),
    "find_not_finite": ("find_not_finite",),
    "verdict": ("optimiser", "verdict"),
    "find_overflow": ("optimiser", "philox", "dropout", "row_gradient", "channel_gradient", "find_overflow"),
    "find_sh_overflow": ("optimiser", "find_sh_overflow"),
    "adam_rows": ("optimiser", "philox", "dropout", "row_gradient", "adam_rows"),
    "adam_sh": ("optimiser", "adam_sh"),
    "adam_channels": ("optimiser", "channel_gradient", "adam_channels"),
    "noise": ("philox", "noise"),
    "limits": ("optimiser", "limits"),
    "error_gradient": ("error_gradient",),
    "add_errors": ("optimiser", "add_errors"),
    **{
        f"search_{part}": ("search", f"search_{part}")
        for part in ("sample", "codes", "permute", "points", "boxes", "nearest")
    },
    "extremes": ("extremes",),
    "gather_rows": ("gather_rows",),
    "gather_sh": ("gather_sh",),
    "adam_exposure": ("optimiser", "tree_sum_4", "adam_exposure"),
}
"""Files of each kernel, after ``common``."""


def backward_sizes(n_channels: int) -> dict[str, int]:
    """Return the sizes in blend_backward.wgsl.

    Workgroup memory decides how many workgroups run at a time: NVIDIA's Vulkan driver gives 48 KiB to a multiprocessor.
    Two run with up to 26 channels, as many as the registers allow; more channels take all that a workgroup may have.
    """
    columns, chunks = n_channels + 6, -(-n_channels // 4)
    subs = max(1, 32 // columns)
    group = 6 if subs >= 3 else 4
    effects = 8 * group * 2 * 9
    memory = 24_000 if columns <= 32 else 32_000
    slots = min(256, (memory - 16 * effects - 32 * (48 + 16 * chunks) - 96) // (4 * columns))
    return {
        "COLUMNS": columns,
        "SUBS": subs,
        "GROUP": group,
        "BATCH_COLORS": 32 * chunks,
        "EFFECTS": effects,
        "SLOTS": slots,
        "SUMS": slots * columns,
    }


def _constants(n_channels: int, n_moving: int, float64: bool) -> str:
    chunks = -(-n_channels // 4)
    floats = {
        "ALPHA_MIN": settings.ALPHA_MIN,
        "ALPHA_MAX": settings.ALPHA_MAX,
        "T_MIN": settings.T_MIN,
        "INVERSE_ALPHA_MIN": settings.INVERSE_ALPHA_MIN,
        "QUAT_NORM2_MIN": settings.QUAT_NORM2_MIN,
        "DET_MIN": settings.DET_MIN,
        "COV_MAX": settings.COV_MAX,
        "DIRECTION_NORM_MIN": settings.DIRECTION_NORM_MIN,
        "RADIUS_SIGMAS": settings.RADIUS_SIGMAS,
        **{f"WINDOW_{i}": float(weight) for i, weight in enumerate(SSIM_WINDOW)},
        "SSIM_C1": float(SSIM_C1),
        "SSIM_C2": float(SSIM_C2),
        "BYTE": float(np.float32(1.0 / 255.0)),
        "NORM_MIN": 1e-9,
        "LN2": math.log(2.0),
        "SH0": 0.5 / math.sqrt(math.pi),
        "SH1": math.sqrt(3.0 / (4.0 * math.pi)),
        "SH2": 0.5 * math.sqrt(15.0 / math.pi),
        "SH20": 0.25 * math.sqrt(5.0 / math.pi),
        "SH33": 0.25 * math.sqrt(35.0 / (2.0 * math.pi)),
        "SH32": 0.5 * math.sqrt(105.0 / math.pi),
        "SH31": 0.25 * math.sqrt(21.0 / (2.0 * math.pi)),
        "SH30": 0.25 * math.sqrt(7.0 / math.pi),
    }
    unsigned = {
        "CHANNELS": n_channels,
        "CHUNKS": chunks,
        **backward_sizes(n_channels),
        "SORT_BLOCK": SORT_BLOCK,
        "SCAN_BLOCK": SCAN_BLOCK,
        "CULLED_NEAR": 1,
        "CULLED_DEGENERATE": 2,
        "CULLED_TRANSPARENT": 3,
        "CULLED_OUTSIDE": 4,
        "N_PAIRS": 1,
        "N_WANTED": 2,
        "NOT_FINITE": 3,
    }
    lines = [f"alias real = {'f64' if float64 else 'f32'};"]
    # ROOT_SCALE enters float64 formulas.
    suffix = "lf" if float64 else "f"
    lines.append(f"const ROOT_SCALE: real = {math.sqrt(0.5 / math.log(2.0))!r}{suffix};")
    lines += [f"const {name}: f32 = {value!r}f;" for name, value in floats.items()]
    lines += [f"const {name}: u32 = {value}u;" for name, value in unsigned.items()]
    for chunk in range(chunks):
        moves = ", ".join("1.0" if 4 * chunk + k < n_moving else "0.0" for k in range(4))
        lines.append(f"const MOVES_{chunk} = vec4<f32>({moves});")
    return "\n".join(lines) + "\n"


def _unroll(text: str, group: int) -> str:
    lines: list[str] = []
    block: list[str] = []
    order: Sequence[int] = (-1,)  # outside of a block
    for line in text.splitlines():
        if line.startswith("//for G "):
            order = range(group) if line.endswith("up") else range(group)[::-1]
        elif line == "//done":
            lines += [row.replace("_G", f"_{k}").replace("G_", f"{k}u") for k in order for row in block]
            block, order = [], (-1,)
        else:
            (lines if -1 in order else block).append(line)
    return "\n".join(lines)


def _expand(text: str, n_channels: int) -> str:
    lines: list[str] = []
    for line in _unroll(text, backward_sizes(n_channels)["GROUP"]).splitlines():
        if line.endswith("// each Q"):
            body = line[: -len("// each Q")]
            lines += [body.replace("_Q", f"_{q}").replace("Q_", f"{q}u") for q in range(-(-n_channels // 4))]
        elif line.endswith("// each C"):
            body = line[: -len("// each C")]
            lines += [body.replace("_QC", f"_{c // 4}[{c % 4}]").replace("C_", f"{c}u") for c in range(n_channels)]
        elif line.endswith("// each P"):
            body = line[: -len("// each P")]
            lines += [body.replace("_P", f"_{p}").replace("P_", f"{p}u") for p in range(-(-(n_channels + 6) // 32))]
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


@functools.lru_cache(maxsize=64)
def _file(name: str) -> str:
    return read_text(Path(__file__).parent / "shaders" / f"{name}.wgsl", advice="Set up the engine again.")


def kernel_source(name: str, n_channels: int, n_moving: int, *, float64: bool) -> str:
    """Return the WGSL of a kernel for `n_channels` channels, of which the first `n_moving` move Gaussians."""
    text = "".join(_file(part) for part in ("common", *KERNELS[name]))
    return _constants(n_channels, n_moving, float64) + _expand(text, n_channels)


class Kernels:
    """Compiled kernels of one card. Each is compiled when it is first asked for.

    Parameters
    ----------
    gpu : Gpu
    """

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._pipelines: dict[tuple[str, str, int, int], Any] = {}

    def get(self, name: str, entry: str = "main", n_channels: int = 4, n_moving: int = 4) -> Any:
        """Return the compute pipeline of a kernel's function `entry`."""
        key = (name, entry, n_channels, n_moving)
        if key not in self._pipelines:
            code = kernel_source(name, n_channels, n_moving, float64=self._gpu.float64)
            module = create_module(self._gpu.device, name, code)
            self._pipelines[key] = self._gpu.device.create_compute_pipeline(
                label=name, layout="auto", compute={"module": module, "entry_point": entry}
            )
        return self._pipelines[key]


@functools.lru_cache(maxsize=4)
def kernels_of(gpu: Gpu) -> Kernels:
    """Return the kernels of a card, one set for the whole process."""
    return Kernels(gpu)
