"""Cost of the rasterizer, the loss and Adam on the CPU: ``python -m benchmarks.raster [--gaussians N] [--threads N]``.

Prints a table of CPU and wall milliseconds (least of the repeats; CPU time is the honest figure on a shared machine).
The scene has 20,000 Gaussians with 3-sigma radii of 2 to 15 pixels at 640x480, opacity sigmoid N(0, 1.5).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable

import numpy as np
import torch

from engine.cameras.camera import PinholeCamera
from engine.rasterizer.adam import AdamState, adam_step
from engine.rasterizer.api import rasterize
from engine.rasterizer.loss import Target, photometric_loss
from engine.rasterizer.settings import RasterSettings

WIDTH, HEIGHT = 640, 480


def make_scene(n: int, sh_degree: int) -> dict[str, torch.Tensor]:
    """Return `n` Gaussians that fill the picture, with the sizes of the figures in the design."""
    rng = np.random.default_rng(3)
    depth = rng.uniform(1, 10, n)
    focal = 500.0
    x = (rng.uniform(0, WIDTH, n) - WIDTH / 2) / focal * depth
    y = (rng.uniform(0, HEIGHT, n) - HEIGHT / 2) / focal * depth
    sigma = np.exp(rng.uniform(math.log(2.0), math.log(15.0), n)) / 3.0 * depth / focal
    scales = sigma[:, None] * np.stack([np.ones(n), rng.uniform(0.25, 1, n), rng.uniform(0.25, 1, n)], 1)
    values = {
        "means": np.stack([x, y, depth], 1),
        "quats": rng.normal(size=(n, 4)),
        "scales": scales,
        "opacities": 1 / (1 + np.exp(-rng.normal(0, 1.5, n))),
        "sh": rng.normal(0, 0.3, (n, (sh_degree + 1) ** 2, 3)),
        "features": rng.normal(0, 0.3, (n, 16)),
    }
    return {name: torch.tensor(value, dtype=torch.float32, requires_grad=True) for name, value in values.items()}


def measure(name: str, work: Callable[[], object], repeats: int) -> None:
    """Print the least CPU and wall milliseconds of `work`."""
    work()
    cpu, wall = [], []
    for _ in range(repeats):
        c, w = time.process_time(), time.perf_counter()
        work()
        cpu.append(1e3 * (time.process_time() - c))
        wall.append(1e3 * (time.perf_counter() - w))
    line = f"{name:44s} cpu {min(cpu):7.1f} ms (median {np.median(cpu):7.1f})   wall {min(wall):7.1f} ms"
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gaussians", type=int, default=20_000)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--repeats", type=int, default=20)
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # its OpenMP threads spin at barriers: on a busy machine they cost more than the work
    settings = RasterSettings(threads=arguments.threads)
    k = np.array([[500.0, 0, WIDTH / 2], [0, 500.0, HEIGHT / 2], [0, 0, 1]])
    camera = PinholeCamera(np.eye(4), k, WIDTH, HEIGHT)
    scene = make_scene(arguments.gaussians, 1)
    geometry = [scene[name] for name in ("means", "quats", "scales", "opacities")]
    photo = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(1))
    target = Target(photo)

    def render(with_features: bool) -> torch.Tensor:
        channels = scene["features"] if with_features else None
        return rasterize(*geometry, camera=camera, sh=scene["sh"], channels=channels, settings=settings).image

    start = time.perf_counter()
    image = render(True)
    image.backward(torch.ones_like(image))
    sys.stdout.write(f"first call, compiled or loaded from the cache: {time.perf_counter() - start:.2f} s\n")

    for name, with_features in (("RGB (SH degree 1)", False), ("RGB + 16", True)):
        with torch.no_grad():
            upstream = torch.randn(HEIGHT, WIDTH, 19 if with_features else 3)

        def forward(with_features: bool = with_features) -> object:
            with torch.no_grad():
                return render(with_features)

        def both(with_features: bool = with_features, upstream: torch.Tensor = upstream) -> None:
            for parameter in scene.values():
                parameter.grad = None
            render(with_features).backward(upstream)

        measure(f"{name}: forward", forward, arguments.repeats)
        measure(f"{name}: forward and backward", both, arguments.repeats)

    leaf = torch.rand(HEIGHT, WIDTH, 3, requires_grad=True)
    measure("loss and gradient, target kept", lambda: photometric_loss(leaf, target).backward(), arguments.repeats)
    measure("loss and gradient, target made new", lambda: photometric_loss(leaf, photo).backward(), arguments.repeats)
    parameters = list(scene.values())
    states = [AdamState.zeros_like(parameter) for parameter in parameters]
    gradients = [torch.randn_like(parameter) for parameter in parameters]
    groups = [(p, g, 0.0) for p, g in zip(parameters, gradients, strict=True)]
    measure("Adam", lambda: adam_step(groups, states), arguments.repeats)

    def step() -> None:
        for parameter in parameters:
            parameter.grad = None
        photometric_loss(render(False), target).backward()
        trained = [(p, s) for p, s in zip(parameters, states, strict=True) if p.grad is not None]
        adam_step([(p, p.grad, 0.0) for p, _ in trained if p.grad is not None], [s for _, s in trained])

    measure("whole RGB step", step, arguments.repeats)


if __name__ == "__main__":
    main()
