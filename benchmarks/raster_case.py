"""One case of `benchmarks.raster`, measured in its own process, which prints the figures as JSON on its last line."""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from engine.rasterizer import rasterize
from engine.rasterizer.blend_backward import MOMENTS_SIZE, blend_tiles_backward
from engine.rasterizer.blend_forward import GEOMETRY_SIZE, blend_tiles
from engine.rasterizer.settings import RADIUS_SIGMAS, RasterSettings
from engine.rasterizer.threads import Share, run_shared
from engine.rasterizer.tiles import make_tile_lists
from engine.scene import PinholeCamera
from engine.training import AdamState, Target, adam_step, photometric_loss

from .floor import arithmetic_floor_ms, count_operations, time_fmas_ms
from .raster import Case
from .textbook import Ellipses, ScalarRaster

_FOCAL = 500.0
"""Focal length of the camera in pixels."""


def make_scene(case: Case) -> tuple[dict[str, torch.Tensor], PinholeCamera]:
    """Return Gaussians that fill the image, with radii of 2 to 15 pixels for any image size, and the camera."""
    rng = np.random.default_rng(3)
    n, width, height = case.n, case.width, case.height
    depth = rng.uniform(1, 10, n)
    x = (rng.uniform(0, width, n) - width / 2) / _FOCAL * depth
    y = (rng.uniform(0, height, n) - height / 2) / _FOCAL * depth
    sigma = np.exp(rng.uniform(math.log(2.0), math.log(15.0), n)) / 3.0 * depth / _FOCAL
    values = {
        "means": np.stack([x, y, depth], 1),
        "quats": rng.normal(size=(n, 4)),
        "scales": sigma[:, None] * np.stack([np.ones(n), rng.uniform(0.25, 1, n), rng.uniform(0.25, 1, n)], 1),
        "opacities": 1 / (1 + np.exp(-rng.normal(0, 1.5, n))),
    }
    if case.channels != 16:
        values["sh"] = rng.normal(0, 0.3, (n, 4, 3))
    if case.channels != 3:
        values["channels"] = rng.normal(0, 0.3, (n, 16))
    k = np.array([[_FOCAL, 0, width / 2], [0, _FOCAL, height / 2], [0, 0, 1]])
    scene = {name: torch.tensor(value, dtype=torch.float32, requires_grad=True) for name, value in values.items()}
    return scene, PinholeCamera(np.eye(4), k, width, height)


def shortest_times(work: Callable[[], object], repeats: int) -> dict[str, float]:
    """Return the shortest CPU and wall time of `work` in milliseconds, after one call that is not measured."""
    work()
    cpu, wall = [], []
    for _ in range(repeats):
        c, w = time.process_time(), time.perf_counter()
        work()
        cpu.append(1e3 * (time.process_time() - c))
        wall.append(1e3 * (time.perf_counter() - w))
    return {"cpu_ms": min(cpu), "wall_ms": min(wall)}


class _Ours:
    """Our rasterizer on a scene."""

    def __init__(self, case: Case, backend: str = "cpu") -> None:
        self.scene, self.camera = make_scene(case)
        self.settings = RasterSettings(threads=case.threads)
        self.backend = backend
        self.upstream = torch.randn(case.height, case.width, case.channels)

    def render(self) -> torch.Tensor:
        """Return the image."""
        geometry = [self.scene[name] for name in ("means", "quats", "scales", "opacities")]
        return rasterize(
            *geometry,
            camera=self.camera,
            sh=self.scene.get("sh"),
            channels=self.scene.get("channels"),
            settings=self.settings,
            backend=self.backend,  # type: ignore[arg-type]
        ).image

    def forward_backward(self) -> None:
        """Render and compute all gradients."""
        for parameter in self.scene.values():
            parameter.grad = None
        self.render().backward(self.upstream)

    def masks(self) -> np.ndarray:
        """Return the blocks that each pair of a tile and a Gaussian changes."""
        view = self.render().grad_fn.view  # type: ignore[union-attr]
        masks: np.ndarray = view.masks
        return masks


def _cpu(case: Case) -> dict[str, float]:
    ours = _Ours(case)
    return {**shortest_times(ours.forward_backward, case.repeats), "pairs": len(ours.masks())}


def _speed_up(case: Case) -> dict[str, float]:
    """Measure one and two threads alternately, so that other programs slow both down equally.

    Plain arithmetic on one and two threads shows whether two cores were free.
    """
    one_thread, two_threads = _Ours(replace(case, threads=1)), _Ours(replace(case, threads=2))
    measurements = {
        "one_wall_ms": lambda: shortest_times(one_thread.forward_backward, 1)["wall_ms"],
        "two_wall_ms": lambda: shortest_times(two_threads.forward_backward, 1)["wall_ms"],
        "one_fma_ms": lambda: time_fmas_ms(1),
        "two_fma_ms": lambda: time_fmas_ms(2),
    }
    times = [{name: measure() for name, measure in measurements.items()} for _ in range(case.repeats)]
    return {name: min(time[name] for time in times) for name in measurements}


def _blend(case: Case) -> dict[str, float]:
    """Measure tile lists and blending without the projection, forward and backward, as for the scalar rasterizer.

    Each repeat is followed by the same amount of plain arithmetic, so that clock speed and other programs affect both
    equally.
    """
    ours = _Ours(case)
    projected = ours.render().grad_fn.view.projected  # type: ignore[union-attr]
    n_colors = projected.colors.shape[1]
    colors, upstream = projected.colors.reshape(-1), ours.upstream.numpy().reshape(-1)
    image, transmittance = np.empty(upstream.shape, np.float32), np.empty(case.width * case.height, np.float32)
    size = (case.width, case.height)

    def forward_backward() -> None:
        lists = make_tile_lists(projected, *size, case.threads)
        masks = np.empty(len(lists.gaussians), np.uint16)
        geometry = np.empty(len(masks) * GEOMETRY_SIZE, np.float32)
        pairs = np.empty(len(masks) * (MOMENTS_SIZE + n_colors), np.float32)

        def forward(share: Share) -> None:
            blend_tiles(
                share, lists.all_tiles, *size, lists.tile_start, lists.gaussians, projected.pixels.reshape(-1),
                projected.roots.reshape(-1), projected.limits, projected.screen_opacities, colors, n_colors,
                case.channels, image, transmittance, masks, geometry,
            )  # fmt: skip

        def backward(share: Share) -> None:
            blend_tiles_backward(
                share, lists.all_tiles, *size, lists.tile_start, lists.gaussians, geometry, colors, n_colors,
                case.channels, case.channels, masks, upstream, np.empty(0, np.float32), pairs,
            )  # fmt: skip

        run_shared(forward, case.threads)
        run_shared(backward, case.threads)

    n_operations = count_operations(ours.masks(), case.channels)
    times = [
        {**shortest_times(forward_backward, 1), "floor_ms": arithmetic_floor_ms(n_operations)}
        for _ in range(case.repeats)
    ]
    shortest = {name: min(time[name] for time in times) for name in times[0]}
    return {**shortest, "peak_gflops": 1e-6 * n_operations / shortest["floor_ms"]}


def _reference(case: Case) -> dict[str, float]:
    return shortest_times(_Ours(case, "reference").forward_backward, case.repeats)


def _accuracy(case: Case) -> dict[str, float]:
    """Return the relative error of each Gaussian's gradients against float64, for the worst of all parameters.

    For a row with a norm below a thousandth of the median norm, the error is relative to that thousandth.
    """
    ours, truth = _Ours(case), _Ours(case, "reference")
    truth.scene = {name: value.detach().double().requires_grad_() for name, value in ours.scene.items()}
    truth.upstream = ours.upstream.double()
    ours.forward_backward()
    truth.forward_backward()
    quantiles = {"median": 0.0, "99.9 %": 0.0}
    for name in truth.scene:
        exact, approximate = (scene[name].grad.double().reshape(case.n, -1) for scene in (truth.scene, ours.scene))
        size = exact.norm(dim=1)
        errors = (approximate - exact).norm(dim=1) / size.clamp(min=1e-3 * float(size[size > 0].median()))
        for key, share in zip(quantiles, (0.5, 0.999), strict=True):
            quantiles[key] = max(quantiles[key], float(errors.quantile(share)))
    return quantiles


def _scalar(case: Case) -> dict[str, float]:
    scene, camera = make_scene(case)
    arrays = {name: value.detach().numpy() for name, value in scene.items()}
    raster = ScalarRaster(_ellipses(arrays, camera), _colors(arrays, case), case.width, case.height)
    upstream = np.random.default_rng(0).normal(size=(case.height, case.width, case.channels)).astype(np.float32)
    return shortest_times(lambda: raster.forward_backward(upstream), case.repeats)


def _colors(arrays: dict[str, np.ndarray], case: Case) -> np.ndarray:
    """Return colours [N, K] to blend, constant ones instead of harmonics, because the values do not affect the time."""
    parts = [np.full((case.n, 3), 0.5, np.float32)] if "sh" in arrays else []
    return np.concatenate(parts + ([arrays["channels"]] if "channels" in arrays else []), axis=1)


def _ellipses(arrays: dict[str, np.ndarray], camera: PinholeCamera) -> Ellipses:
    """Project the Gaussians in NumPy, outside of the measured time."""
    x, y, z = arrays["means"].astype(np.float64).T
    w, i, j, k = (arrays["quats"] / np.linalg.norm(arrays["quats"], axis=1, keepdims=True)).astype(np.float64).T
    rotation = np.array(
        [
            [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)],
            [2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)],
            [2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)],
        ]
    ).transpose(2, 0, 1)
    zero = np.zeros_like(z)
    jacobian = _FOCAL * np.array([[1 / z, zero, -x / z**2], [zero, 1 / z, -y / z**2]]).transpose(2, 0, 1)
    m = jacobian @ rotation * arrays["scales"][:, None, :]
    cov = m @ m.transpose(0, 2, 1) + RasterSettings().low_pass * np.eye(2)
    inverse = np.linalg.inv(cov)
    pixels = _FOCAL * np.stack([x / z, y / z], 1) + camera.K[:2, 2]
    return Ellipses(
        pixels.astype(np.float32),
        np.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], 1).astype(np.float32),
        arrays["opacities"],
        z.astype(np.float32),
        np.ceil(RADIUS_SIGMAS * np.sqrt(np.linalg.eigvalsh(cov)[:, 1])).astype(np.float32),
    )


def _step(case: Case) -> dict[str, float]:
    """Measure a training step without features, with projection, harmonics of degree 1, blending, loss and Adam."""
    return shortest_times(_Step(case).run, case.repeats)


def _parts(case: Case) -> dict[str, float]:
    """Return the CPU milliseconds of each part of a training step."""
    step = _Step(case)
    leaf = torch.rand(case.height, case.width, 3, requires_grad=True)

    def forward() -> None:
        with torch.no_grad():
            step.ours.render()

    work: dict[str, Callable[[], object]] = {
        "forward": forward,
        "forward and backward": step.ours.forward_backward,
        "loss L1 + SSIM and its gradient": lambda: photometric_loss(leaf, step.target).backward(),
        "Adam": step.adam,
    }
    return {name: shortest_times(call, case.repeats)["cpu_ms"] for name, call in work.items()}


class _Step:
    """A training step on a random photo."""

    def __init__(self, case: Case) -> None:
        self.ours = _Ours(case)
        self.target = Target(torch.rand(case.height, case.width, 3, generator=torch.Generator().manual_seed(1)))
        self.parameters = list(self.ours.scene.values())
        self.states = [AdamState.zeros_like(parameter) for parameter in self.parameters]
        self.ours.forward_backward()

    def run(self) -> None:
        """Run the step once."""
        for parameter in self.parameters:
            parameter.grad = None
        photometric_loss(self.ours.render(), self.target).backward()
        self.adam()

    def adam(self) -> None:
        """Update the parameters with a learning rate of zero, which takes as long as any other rate."""
        groups = [(p, p.grad, 0.0) for p in self.parameters if p.grad is not None]
        adam_step(groups, self.states)


def _memory(case: Case) -> dict[str, float]:
    """Return the peak memory of a forward and backward pass without the scene and the compiled code."""
    _Ours(Case("cpu", n=100, channels=case.channels)).forward_backward()
    ours = _Ours(case)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ours.forward_backward()
    return {"bytes": 1024.0 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)}


def _compile(case: Case) -> dict[str, float]:
    """Return the seconds of `compile_kernels`, without imports, with an empty and then with a filled cache."""
    code = (
        "import os, time, torch; torch.set_num_threads(1); from engine.training.compilation import compile_kernels; "
        "cpu = lambda: sum(os.times()[:4]); wall, used = time.perf_counter(), cpu(); compile_kernels(); "
        "print(time.perf_counter() - wall, cpu() - used)"
    )
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        (wall, cpu), (_, cpu_cached) = (
            map(float, subprocess.run(
                [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
            ).stdout.split())
            for _ in range(2)
        )  # fmt: skip
    return {"first_wall_s": wall, "first_cpu_s": cpu, "cached_cpu_s": cpu_cached}


def measure(case: Case) -> dict[str, float]:
    """Return the figures of a case by name."""
    measurements = {
        "cpu": _cpu, "speed_up": _speed_up, "blend": _blend, "reference": _reference, "accuracy": _accuracy,
        "scalar": _scalar, "step": _step, "parts": _parts, "memory": _memory, "compile": _compile,
    }  # fmt: skip
    return measurements[case.what](case)


def main() -> None:
    """Measure the case that is given as JSON."""
    torch.set_num_threads(1)  # On a busy machine, spinning OpenMP threads cost more than they save.
    print(json.dumps(measure(Case(**json.loads(sys.argv[1])))))


if __name__ == "__main__":
    main()
