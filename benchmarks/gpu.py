"""Cost of the ``gpu`` backend beside gsplat on the same card, in the same run: ``make bench-gpu``.

Each part takes minutes and writes a JSON file; ``document`` merges them into docs/gpu.md. gsplat is left out where it
is not installed or torch has no CUDA.

example: python -m benchmarks.gpu scene 1000000
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.documents import put_into
from benchmarks.gpu_document import document
from engine.rasterizer.gpu import Frame, FrameSize, Gpu, open_adapter
from engine.rasterizer.gpu.layout import pack_sh
from engine.rasterizer.gpu.modules import create_module
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


def n_pairs(gpu: Gpu, arrays: dict[str, np.ndarray]) -> int:
    """Return the number of pairs of a tile and a Gaussian."""
    n = len(arrays["means"])
    frame = Frame(gpu, FrameSize(n, 0, 1, WIDTH, HEIGHT, 1, backward=False))
    for name in ("means", "quats", "scales", "opacities"):
        frame.write(name, arrays[name])
    frame.write("channels", np.zeros((n, 1), np.float32))
    frame.set_view(camera(), RasterSettings(), 0)
    frame.forward()
    return frame.counts().n_wanted


def measure_ours(gpu: Gpu, arrays: dict[str, np.ndarray], case: str, capacity: int) -> dict[str, Any]:
    """Return medians in milliseconds: stages, forward, forward and backward, wall time a step; and memory."""
    frame = new_frame(gpu, arrays, case, capacity)
    watch = Stopwatch(gpu)
    rows: list[dict[str, float]] = []
    for _ in range(100):  # the card reaches its clock
        frame.forward()
        frame.backward()
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
        "n_pairs": counts.n_pairs,
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


def _kernel_ms(gpu: Gpu, code: str, buffers: Sequence[Any], groups: int) -> float:
    pipeline = gpu.device.create_compute_pipeline(
        layout="auto", compute={"module": create_module(gpu.device, "ceiling", code), "entry_point": "main"}
    )
    entries = [
        {"binding": i, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
        for i, buffer in enumerate(buffers)
    ]
    bindings = gpu.device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
    watch = Stopwatch(gpu)
    times = []
    for _ in range(REPEATS):
        encoder = gpu.device.create_command_encoder()
        compute = encoder.begin_compute_pass(timestamp_writes=watch("kernel", encoder))
        compute.set_pipeline(pipeline)
        compute.set_bind_group(0, bindings)
        compute.dispatch_workgroups(groups, 1, 1)
        compute.end()
        gpu.device.queue.submit([encoder.finish()])
        times.append(watch.read()["kernel"])
    return min(times)


def measure_ceilings(gpu: Gpu) -> dict[str, float]:
    """Return what simple kernels reach: bytes copied, float32 operations; and torch.sort where there is CUDA."""
    size = min(1 << 28, gpu.max_binding_bytes)
    buffers = [gpu.device.create_buffer(size=size, usage=0x80 | 0x8 | 0x4) for _ in range(2)]
    copy = """@group(0) @binding(0) var<storage, read> from_: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> to: array<vec4<f32>>;
@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var i = id.x; i < arrayLength(&to); i += groups.x * 256u) { to[i] = from_[i]; }
}"""
    fma = """@group(0) @binding(0) var<storage, read_write> to: array<vec4<f32>>;
@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    var a = vec4<f32>(f32(id.x)); var b = a + 1.0; var c = a + 2.0; var d = a + 3.0;
    for (var i = 0u; i < 1024u; i++) {
        a = fma(a, vec4<f32>(0.5), b); b = fma(b, vec4<f32>(0.5), c);
        c = fma(c, vec4<f32>(0.5), d); d = fma(d, vec4<f32>(0.5), a);
    }
    to[id.x] = a + b + c + d;
}"""
    groups = min(32768, size // 4096)
    found = {
        "copy_gb_s": 2 * size / _kernel_ms(gpu, copy, buffers, groups) * 1e-6,
        "fma_tflop_s": groups * 256 * 1024 * 16 * 2 / _kernel_ms(gpu, fma, buffers[:1], groups) * 1e-9,
    }
    if has_cuda():
        import torch

        for n in (1_000_000, 2_000_000):
            keys = torch.randint(0, 2**31 - 1, (n,), dtype=torch.int32, device="cuda")
            found[f"torch_sort_{n}_ms"] = _cuda_ms(lambda keys=keys: torch.sort(keys))  # type: ignore[misc]
    return found


def first_picture() -> dict[str, float]:
    """Return the seconds to open the card, and to compile all kernels and render a small picture and its gradients."""
    start = time.perf_counter()
    gpu = open_adapter(software=True)
    opened = time.perf_counter()
    frame = Frame(gpu, FrameSize(64, 16, 16, 32, 32, 4096))
    rng = np.random.default_rng(0)
    for name, width in (("means", 3), ("quats", 4), ("scales", 3), ("channels", 16)):
        frame.write(name, rng.uniform(1.0, 2.0, (64, width)).astype(np.float32))
    frame.write("opacities", np.full(64, 0.5, np.float32))
    frame.set_view(PinholeCamera(np.eye(4), np.diag([32.0, 32.0, 1.0]), 32, 32), RasterSettings(), 3)
    frame.forward()
    frame.backward()
    frame.counts()
    return {"open": opened - start, "compile": time.perf_counter() - opened}


def measure_starts() -> dict[str, dict[str, float]]:
    """Return `first_picture` of two processes: with an empty cache of the driver, and with what the first one left."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        caches = ("__GL_SHADER_DISK_CACHE_PATH", "MESA_SHADER_CACHE_DIR", "XDG_CACHE_HOME")
        environment = {**os.environ, **{name: folder for name in caches}}
        for which in ("first", "second"):
            command = [sys.executable, "-m", "benchmarks.gpu", "first-picture"]
            child = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            found[which] = json.loads(child.stdout.splitlines()[-1])
    return found


def has_cuda() -> bool:
    """Return whether torch can use a card."""
    import torch

    return bool(torch.cuda.is_available())


def measure_scene(gpu: Gpu, n: int) -> dict[str, Any]:
    """Return the results of all cases with `n` Gaussians, ours and where possible gsplat's."""
    started = time.perf_counter()
    arrays = scene(n)
    pairs = n_pairs(gpu, arrays)
    capacity = pairs + pairs // 8  # as `rasterize_gpu` grows its buffers
    part: dict[str, Any] = {"ours": {case: measure_ours(gpu, arrays, case, capacity) for case in CASES}}
    if importlib.util.find_spec("gsplat") is not None and has_cuda():
        import gsplat
        import torch

        part["versions"] = {"gsplat": gsplat.__version__, "torch": torch.__version__}
        part["gsplat"] = measure_gsplat(arrays)
    part["seconds"] = time.perf_counter() - started
    return part


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure one part, or write the document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("scene", "start", "ceilings", "document", "first-picture"))
    parser.add_argument("n", type=int, nargs="?", default=1_000_000, help="number of Gaussians of a scene")
    parser.add_argument("--results", type=Path, default=Path("out/gpu"))
    parser.add_argument("--doc", type=Path, default=Path("docs/gpu.md"))
    options = parser.parse_args(arguments)
    if options.part == "first-picture":
        print(json.dumps(first_picture()))
        return
    if options.part == "document":
        put_into(options.doc, "figures", document(options.results))
        return
    gpu = open_adapter()
    if options.part == "start":
        name, found = "start", measure_starts()
    elif options.part == "ceilings":
        name, found = "ceilings", measure_ceilings(gpu)
    else:
        name, found = f"scene_{options.n}", measure_scene(gpu, options.n)
    machine = {"card": gpu.name, "driver": gpu.driver, "interface": gpu.backend, "wgpu": version("wgpu")}
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / f"{name}.json").write_text(json.dumps({"machine": machine, **found}, indent=1))
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
