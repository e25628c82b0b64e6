"""Cost of the ``gpu`` backend beside gsplat on the same card, in the same run, for one number of Gaussians.

The figures are printed and added to a JSON file. gsplat is left out where it is not installed; where it is, torch needs
CUDA.

example: python -m benchmarks.gpu 1000000
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from engine.rasterizer.gpu import Frame, FrameSize, Gpu, open_adapter
from engine.rasterizer.gpu.layout import pack_sh
from engine.rasterizer.settings import RasterSettings
from engine.scene import PinholeCamera

WIDTH, HEIGHT = 1920, 1080
FOCAL = WIDTH / 2 / math.tan(math.radians(30))
REPEATS = 30
WALL_STEPS = 200

CASES = {"RGB": (0, 3), "RGB, SH 3": (16, 0), "16": (0, 16), "RGB+16": (0, 19), "RGB+16, SH 3": (16, 16)}
"""Name of each case: coefficients of spherical harmonics, and channels beside them."""


def camera() -> PinholeCamera:
    """Return a camera at the origin that looks along z."""
    k = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    return PinholeCamera(np.eye(4), k, WIDTH, HEIGHT)


def scene(n: int) -> dict[str, np.ndarray]:
    """Return `n` Gaussians between 3 and 6 units away, whose median standard deviation is 1.5 pixels."""
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(n, 4))
    arrays = {
        "means": rng.uniform([-3.0, -1.7, 3.0], [3.0, 1.7, 6.0], (n, 3)),
        "quats": quats / np.linalg.norm(quats, axis=1, keepdims=True),
        "scales": np.exp(math.log(1.5 * 4.5 / FOCAL) + 0.5 * rng.normal(size=(n, 3))),
        "opacities": 1.0 / (1.0 + np.exp(-1.5 * rng.normal(size=n))),
        "sh": np.concatenate([0.5 * rng.normal(size=(n, 1, 3)), 0.05 * rng.normal(size=(n, 15, 3))], axis=1),
        "channels": np.concatenate([rng.uniform(size=(n, 3)), 0.3 * rng.normal(size=(n, 16))], axis=1),
    }
    return {name: values.astype(np.float32) for name, values in arrays.items()}


class Stopwatch:
    """Timestamps around the stages of a frame's passes."""

    def __init__(self, gpu: Gpu) -> None:
        self._device = gpu.device
        self._queries = gpu.device.create_query_set(type="timestamp", count=64)
        self._target = gpu.device.create_buffer(size=512, usage=0x200 | 0x4)
        self.stages: list[str] = []

    def __call__(self, stage: str, encoder: Any) -> dict[str, Any]:
        """Return the descriptor that measures one compute pass."""
        at = 2 * len(self.stages)
        self.stages.append(stage)
        return {"query_set": self._queries, "beginning_of_pass_write_index": at, "end_of_pass_write_index": at + 1}

    def read(self) -> dict[str, float]:
        """Return milliseconds of each stage since the last reading, and of everything as ``all``."""
        n = 2 * len(self.stages)
        encoder = self._device.create_command_encoder()
        encoder.resolve_query_set(self._queries, 0, n, self._target, 0)
        self._device.queue.submit([encoder.finish()])
        ticks = np.frombuffer(self._device.queue.read_buffer(self._target, 0, 8 * n), np.uint64).astype(np.int64)
        times = {stage: (ticks[2 * i + 1] - ticks[2 * i]) * 1e-6 for i, stage in enumerate(self.stages)}
        times["all"] = (ticks[n - 1] - ticks[0]) * 1e-6
        self.stages = []
        return times


def new_frame(gpu: Gpu, arrays: dict[str, np.ndarray], case: str, capacity: int) -> Frame:
    """Return a frame with the inputs of a case and a random incoming gradient."""
    n_sh, n_channels = CASES[case]
    n = len(arrays["means"])
    frame = Frame(gpu, FrameSize(n, n_sh, n_channels, WIDTH, HEIGHT, capacity))
    for name in ("means", "quats", "scales", "opacities"):
        frame.write(name, arrays[name])
    if n_sh:
        frame.write("sh", pack_sh(arrays["sh"]))
    if n_channels:
        frame.write("channels", arrays["channels"][:, -n_channels:])
    shape = (HEIGHT, WIDTH, frame.size.n_out + 1)
    frame.write("gradient", np.random.default_rng(1).normal(size=shape).astype(np.float32))
    frame.set_view(camera(), RasterSettings(), 3 if n_sh else 0)
    return frame


def measure_ours(gpu: Gpu, arrays: dict[str, np.ndarray], case: str) -> dict[str, Any]:
    """Return medians in milliseconds: stages, forward, forward and backward, wall time a step; and memory."""
    frame = new_frame(gpu, arrays, case, 4 * len(arrays["means"]))
    watch = Stopwatch(gpu)
    rows: list[dict[str, float]] = []
    for i in range(REPEATS + 5):
        frame.forward(watch)
        forward = watch.read()
        frame.forward(watch)
        frame.backward(watch)
        both = watch.read()
        if i >= 5:
            rows.append({**both, "forward": forward["all"]})
    result: dict[str, Any] = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
    frame.counts()
    start = time.perf_counter()
    for _ in range(WALL_STEPS):
        frame.forward()
        frame.backward()
    encoded = time.perf_counter() - start
    counts = frame.counts()
    result |= {
        "wall": (time.perf_counter() - start) / WALL_STEPS * 1e3,
        "encoding": encoded / WALL_STEPS * 1e3,
        "memory_mib": frame.n_bytes / 2**20,
        "pairs": counts.n_pairs,
    }
    assert counts.n_pairs == counts.n_wanted and counts.not_finite == 0
    return result


def _cuda_ms(compute: Callable[[], Any]) -> float:
    import torch

    for _ in range(5):
        compute()
    times = []
    for _ in range(REPEATS):
        start, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
        start.record()
        compute()
        end.record()
        torch.cuda.synchronize()
        times.append(start.elapsed_time(end))
    return statistics.median(times)


def measure_gsplat(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """Return medians in milliseconds of gsplat, forward and both, and its peak memory, by case.

    ``RGB+16`` is the quicker of two ways: one pass with 19 channels, which gsplat pads to 32, and two passes of 3 and
    16 channels that share the projection and the lists.
    """
    import gsplat
    import torch

    tensors = {name: torch.tensor(values, device="cuda", requires_grad=True) for name, values in arrays.items()}
    geometry = [tensors[name] for name in ("means", "quats", "scales", "opacities")]
    viewmats = torch.eye(4, device="cuda")[None]
    ks = torch.tensor(camera().K, dtype=torch.float32, device="cuda")[None]
    colors = tensors["channels"]

    def single(values: Any, degree: int | None) -> list[Any]:
        image, alpha, _ = gsplat.rasterization(
            *geometry, values, viewmats, ks, WIDTH, HEIGHT, sh_degree=degree, packed=False, tile_size=16
        )
        return [image, alpha]

    def split(with_sh: bool) -> list[Any]:
        means, quats, scales, opacities = geometry
        radii, centres, depths, conics, _ = gsplat.fully_fused_projection(
            means, None, quats, scales, viewmats, ks, WIDTH, HEIGHT, packed=False, opacities=opacities
        )
        columns, rows = -(-WIDTH // 16), -(-HEIGHT // 16)
        _, ids, flat = gsplat.isect_tiles(centres, radii, depths, 16, columns, rows, packed=False, n_images=1)
        offsets = gsplat.isect_offset_encode(ids, 1, columns, rows).reshape(1, rows, columns)
        rgb = colors[:, :3]
        if with_sh:
            rgb = (gsplat.spherical_harmonics(3, means, tensors["sh"], masks=(radii[0] > 0).all(-1)) + 0.5).clamp(min=0)
        outputs = []
        for values in (rgb, colors[:, 3:]):
            values = values.contiguous()[None]
            outputs += gsplat.rasterize_to_pixels(
                centres, conics, values, opacities[None], WIDTH, HEIGHT, 16, offsets, flat
            )
        return outputs[:3]

    ways: dict[str, list[Callable[[], list[Any]]]] = {
        "RGB": [lambda: single(colors[:, :3].contiguous(), None)],
        "RGB, SH 3": [lambda: single(tensors["sh"], 3)],
        "16": [lambda: single(colors[:, 3:].contiguous(), None)],
        "RGB+16": [lambda: single(colors, None), lambda: split(False)],
        "RGB+16, SH 3": [lambda: split(True)],
    }
    results = {}
    for case, choices in ways.items():
        rows = []
        for render in choices:
            upstream = [torch.randn_like(output) for output in render()]

            def both(render: Callable[[], list[Any]] = render, upstream: list[Any] = upstream) -> None:
                outputs = render()
                leaves = [t for t in tensors.values()]
                torch.autograd.grad(outputs, leaves, upstream, allow_unused=True)

            with torch.no_grad():
                forward = _cuda_ms(render)
            torch.cuda.empty_cache()
            base = torch.cuda.memory_allocated()
            torch.cuda.reset_peak_memory_stats()
            both()
            peak = (torch.cuda.max_memory_allocated() - base) / 2**20
            rows.append({"forward": forward, "all": _cuda_ms(both), "memory_mib": peak})
        results[case] = min(rows, key=lambda row: row["all"])
    return results


def measure_start(gpu: Gpu) -> float:
    """Return the seconds that compiling all kernels and a first small picture take."""
    start = time.perf_counter()
    frame = Frame(gpu, FrameSize(64, 16, 0, 32, 32, 4096))
    rng = np.random.default_rng(0)
    for name, width in (("means", 3), ("quats", 4), ("scales", 3)):
        frame.write(name, rng.uniform(1.0, 2.0, (64, width)).astype(np.float32))
    frame.write("opacities", np.full(64, 0.5, np.float32))
    frame.set_view(PinholeCamera(np.eye(4), np.diag([32.0, 32.0, 1.0]), 32, 32), RasterSettings(), 3)
    frame.forward()
    frame.backward()
    frame.counts()
    return time.perf_counter() - start


def run_part(n: int, out: Path, *, software: bool) -> None:
    """Measure `n` Gaussians and write the results to `out`, beside those that are there."""
    started = time.perf_counter()
    gpu = open_adapter(software=software)
    start_s = measure_start(gpu)
    arrays = scene(n)
    results = json.loads(out.read_text()) if out.exists() else {"machine": {}, "parts": {}}
    results["machine"] |= {"card": gpu.name, "driver": gpu.driver, "interface": gpu.backend}
    results["machine"].setdefault("starts", []).append(start_s)
    part: dict[str, Any] = {"ours": {case: measure_ours(gpu, arrays, case) for case in CASES}}
    if importlib.util.find_spec("gsplat") is not None:
        import gsplat
        import torch

        results["machine"] |= {"gsplat": gsplat.__version__, "torch": torch.__version__}
        part["gsplat"] = measure_gsplat(arrays)
    part["seconds"] = time.perf_counter() - started
    results["parts"][str(n)] = part
    out.write_text(json.dumps(results, indent=1))
    print(json.dumps(part, indent=1))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure one number of Gaussians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", type=int, help="number of Gaussians")
    parser.add_argument("--results", type=Path, default=Path("out/gpu.json"))
    parser.add_argument("--software", action="store_true")
    options = parser.parse_args(arguments)
    options.results.parent.mkdir(parents=True, exist_ok=True)
    run_part(options.n, options.results, software=options.software)


if __name__ == "__main__":
    main()
