"""Time of the detail of one object of 40 photos of 2 megapixels, by device: ``python -m benchmarks.gpu_detail``.

Scene and photos are drawn from a seed, not made of photos: a striped ball of 10,000 Gaussians in the middle of 50,000
others. Its photos are pictures of 90,000 finer ones. So the times are those of a real object, and the gain is not.

example: python -m benchmarks.gpu_detail --devices gpu
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

from engine.core.arrays import Float32
from engine.core.events import never_stop
from engine.objects import DetailPhotos, Views, detail_object
from engine.objects.settings import BETTER
from engine.pictures import Scene
from engine.quality.stability.training_scenes import look_at_viewmat
from engine.scene import Camera, CameraSet, Gaussians, PinholeCamera

N_PHOTOS, WIDTH, HEIGHT, FOCAL = 45, 1632, 1224, 1400.0
N_BALL, N_FINE, N_ROOM = 10_000, 90_000, 50_000
RADIUS, DISTANCE = 0.55, 2.4


def ball(n: int, rng: np.random.Generator) -> Gaussians:
    """Return `n` Gaussians on a sphere with stripes."""
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    stripes = 0.8 * np.sin(40 * direction[:, :1]) * np.sin(25 * direction[:, 2:]) * np.ones(3)
    size = np.log(1.1 * RADIUS * np.sqrt(4 * np.pi / n))
    return gaussians(RADIUS * direction, np.full((n, 3), size), stripes, rng)


def room(n: int, rng: np.random.Generator) -> Gaussians:
    """Return `n` Gaussians on walls around the ball, and on a floor under it."""
    place = rng.uniform(-4, 4, (n, 3))
    side, sign = rng.integers(3, size=n), rng.choice([-4.0, 4.0], n)
    place[np.arange(n), side] = sign
    place[place[:, 2] < -RADIUS, 2] = -RADIUS
    return gaussians(place, np.full((n, 3), np.log(0.06)), 0.5 * np.sin(3 * place), rng)


def gaussians(means: np.ndarray, log_scales: np.ndarray, colors: np.ndarray, rng: np.random.Generator) -> Gaussians:
    """Return opaque Gaussians with one band of harmonics after the colour."""
    n = len(means)
    sh = np.concatenate([colors[:, None], 0.05 * rng.normal(size=(n, 3, 3))], axis=1)
    arrays = (means, log_scales, rng.normal(size=(n, 4)), np.full(n, 2.0), sh)
    names = ("means", "log_scales", "quats", "opacity_logits", "sh")
    return Gaussians(
        **{name: one.astype(np.float32) for name, one in zip(names, arrays, strict=True)},
        features=np.eye(16, dtype=np.float32)[:1].repeat(n, axis=0),
    )


def cameras() -> list[Camera]:
    """Return cameras on a spiral around the ball."""
    found = []
    for number in range(N_PHOTOS):
        angle, height = 2 * np.pi * 0.381966 * number, 0.2 + 1.2 * number / N_PHOTOS
        center = np.array([DISTANCE * np.cos(angle), DISTANCE * np.sin(angle), height])
        lens = (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
        found.append(Camera(f"photo_{number:02}.jpg", WIDTH, HEIGHT, "PINHOLE", lens, look_at_viewmat(center)))
    return found


def write_photos(folder: Path, scene: Scene, views: list[Camera]) -> None:
    """Write a picture of the scene for each camera."""
    K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    for camera in views:
        picture: Float32 = scene.render(PinholeCamera(camera.viewmat, K, WIDTH, HEIGHT), color=True).channels
        Image.fromarray((np.clip(picture, 0, 1) * 255).astype(np.uint8)).save(folder / camera.photo, quality=92)


def main() -> None:
    """Print seconds and gain of each device."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", default="gpu", help="gpu, cpu or both (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=2, help="the first one compiles kernels (default: %(default)s)")
    options = parser.parse_args()
    devices = options.devices.split(",")
    rng, views = np.random.default_rng(0), cameras()
    rest = room(N_ROOM, rng)
    coarse = ball(N_BALL, rng).joined(rest)
    members = np.arange(len(coarse)) < N_BALL
    nothing = np.zeros((0, 3), np.float32)
    camera_set = CameraSet(tuple(views), (), nothing, nothing.astype(np.uint8), 0.5, np.eye(4), False)
    with tempfile.TemporaryDirectory() as folder:
        write_photos(Path(folder), Scene(ball(N_FINE, rng).joined(rest), backend=devices[0]), views)
        photos = DetailPhotos(Path(folder), frozenset(camera.photo for camera in views[::9]))
        for device in devices:
            for _ in range(options.repeats):
                seen = Views(Scene(coarse, backend=device), camera_set, render_side=BETTER.render_side)
                begun: list[float] = []
                wall, cpu = time.perf_counter(), time.process_time()
                result = detail_object(
                    seen, photos, members, BETTER, should_stop=never_stop,
                    tell=lambda done, left, begun=begun: begun.append(time.perf_counter()) if left else None,
                )  # fmt: skip
                end, used = time.perf_counter(), time.process_time() - cpu
                sys.stdout.write(
                    f"{device}: {end - wall:.1f} s, CPU {used:.1f} s, to the 20th step {begun[0] - wall:.1f} s, "
                    f"after the last {end - begun[-1]:.1f} s: {result.record}\n"
                )


if __name__ == "__main__":
    main()
