"""Assembly of the WGSL kernels for a number of channels, and their compilation.

A kernel is the text of its file after ``common.wgsl``, the files that its first line ``//needs A B`` names, and the
constants of `engine.rasterizer.settings`. Two notations are expanded, because WGSL has no loops at compile time:

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.files import read_text
from ...core.parts import part
from .. import settings
from .adapters import Gpu
from .modules import create_module

SORT_BLOCK = 2048
"""Keys that a workgroup sorts."""

SCAN_BLOCK = 1024
"""Values that a workgroup sums."""

_NEEDS = "//needs "


@dataclass(frozen=True)
class Sources:
    """Where the kernels of a package are written.

    Attributes
    ----------
    folders : tuple of Path
        A file is read from the first of them that has it.
    constants : tuple of (str, float)
        Constants of these kernels besides those of the rasterizer.
    """

    folders: tuple[Path, ...]
    constants: tuple[tuple[str, float], ...] = ()

    @functools.cache  # noqa: B019  (a process has two of them)
    def path_of(self, name: str) -> Path:
        """Return the file of a kernel, or of a part that kernels need."""
        return next(path for folder in self.folders if (path := folder / f"{name}.wgsl").is_file())


RENDERING = Sources((Path(__file__).parent / "shaders",))
"""The kernels of the rasterizer."""


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


def _constants(sources: Sources, n_channels: int, n_moving: int, float64: bool) -> str:
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
        **dict(sources.constants),
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


@functools.lru_cache(maxsize=128)
def _file(path: Path) -> str:
    return read_text(path, advice="Set up the engine again.")


def kernel_source(sources: Sources, name: str, n_channels: int, n_moving: int, *, float64: bool) -> str:
    """Return the WGSL of a kernel for `n_channels` channels, of which the first `n_moving` move Gaussians."""
    own = _file(sources.path_of(name))
    first = own.partition("\n")[0]
    needed = first.removeprefix(_NEEDS).split() if first.startswith(_NEEDS) else []
    text = "".join(_file(sources.path_of(part)) for part in ("common", *needed)) + own
    return _constants(sources, n_channels, n_moving, float64) + _expand(text, n_channels)


class Kernels:
    """Compiled kernels of one card. Each is compiled when it is first asked for."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._pipelines: dict[tuple[Path, str, int, int], Any] = {}

    def get(self, sources: Sources, name: str, entry: str, n_channels: int, n_moving: int) -> Any:
        """Return the compute pipeline of a kernel's function `entry`."""
        key = (sources.path_of(name), entry, n_channels, n_moving)
        if key not in self._pipelines:
            code = kernel_source(sources, name, n_channels, n_moving, float64=self._gpu.float64)
            with part("compilation"):
                module = create_module(self._gpu.device, name, code)
                self._pipelines[key] = self._gpu.device.create_compute_pipeline(
                    label=name, layout="auto", compute={"module": module, "entry_point": entry}
                )
        return self._pipelines[key]


@functools.lru_cache(maxsize=4)
def kernels_of(gpu: Gpu) -> Kernels:
    """Return the kernels of a card, one set for the whole process."""
    return Kernels(gpu)
