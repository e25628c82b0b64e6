"""A tiny scene that is known exactly: two equal red balls and a blue one on a floor, seen by eight cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from engine.pictures.scene import Scene
from engine.scene.camera import Camera, CameraSet, PinholeCamera
from engine.scene.gaussians import Gaussians

WIDTH, HEIGHT, N_VIEWS = 160, 120, 8
FLOOR, RED, TWIN, BLUE = 0, 1, 2, 3
PART_NAMES = {RED: "red ball", TWIN: "red ball", BLUE: "blue ball"}
_CENTERS = {RED: (-0.65, 0.0, 0.0), TWIN: (0.65, 0.1, 0.0), BLUE: (0.0, 0.6, 0.0)}
_COLORS = {FLOOR: (0.75, 0.7, 0.6), RED: (0.85, 0.2, 0.15), TWIN: (0.85, 0.2, 0.15), BLUE: (0.15, 0.3, 0.85)}


@dataclass(frozen=True)
class BlobScene:
    """Gaussians, which part each is of, cameras, and per photo its pixels and true labels (0 floor and nothing)."""

    gaussians: Gaussians
    part: np.ndarray
    cameras: CameraSet
    pixels: dict[str, np.ndarray]
    labels: dict[str, np.ndarray]

    def write_photos(self, folder: Path) -> Path:
        """Write the photos as PNG and return their folder."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, pixels in self.pixels.items():
            Image.fromarray(pixels).save(folder / name)
        return folder

    def center_of(self, part: int, photo: str) -> tuple[float, float]:
        """Pixel in the middle of a part in a photo."""
        rows, columns = np.nonzero(self.labels[photo] == part)
        return float(np.median(columns)), float(np.median(rows))


def photo_name(index: int) -> str:
    return f"view_{index}.png"


def camera_at(angle: float, photo: str) -> Camera:
    """A camera 2.6 away and 1.5 up that looks at the origin; Z is up."""
    center = np.array([2.6 * np.cos(angle), 2.6 * np.sin(angle), 1.5])
    forward = -center / np.linalg.norm(center)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ center
    return Camera(photo, WIDTH, HEIGHT, "PINHOLE", (150.0, 150.0, WIDTH / 2, HEIGHT / 2), viewmat)


def as_pinhole(camera: Camera) -> PinholeCamera:
    """The photo's camera, which has no distortion here, as the rasterizer wants it."""
    fx, fy, cx, cy = camera.params
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return PinholeCamera(camera.viewmat, K, camera.width, camera.height)


def make_scene(*, seed: int = 3) -> BlobScene:
    """Return the scene; `seed` moves every Gaussian a little and changes the noise of the features."""
    rng = np.random.default_rng(seed)
    parts = [np.full(500, FLOOR)] + [np.full(150, part) for part in _CENTERS]
    places = [np.column_stack([rng.uniform(-1.3, 1.3, (500, 2)), np.full(500, -0.33)])]
    for center in _CENTERS.values():
        direction = rng.normal(size=(150, 3))
        places.append(np.array(center) + 0.28 * direction / np.linalg.norm(direction, axis=1, keepdims=True))
    part, means = np.concatenate(parts), np.concatenate(places).astype(np.float32)
    count = len(part)
    features = np.eye(16)[[2, 5, 8, 11]][part] + 0.08 * rng.normal(size=(count, 16))
    colors = np.array([_COLORS[i] for i in range(4)])[part]
    scales = np.where(part == FLOOR, 0.07, 0.06)[:, None] * np.ones(3)
    scales[part == FLOOR, 2] = 0.01
    gaussians = Gaussians(
        means=means,
        log_scales=np.log(scales).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=((colors - 0.5) / 0.28209479177387814).astype(np.float32)[:, None, :],
        features=features.astype(np.float32),
    )
    cameras = tuple(camera_at(0.4 + 2 * np.pi * i / N_VIEWS, photo_name(i)) for i in range(N_VIEWS))
    camera_set = CameraSet(cameras, (), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), 0.5, np.eye(4), False)
    scene = Scene(gaussians)
    pixels, labels = {}, {}
    for camera in cameras:
        frame = as_pinhole(camera)
        seen = scene.render(frame, color=True, channels=np.eye(4, dtype=np.float32)[part])
        pixels[camera.photo] = (np.clip(seen.channels[..., :3], 0, 1) * 255).astype(np.uint8)
        share = seen.channels[..., 3:]
        labels[camera.photo] = np.where(share.max(axis=-1) > 0.5, share.argmax(axis=-1), 0).astype(np.int32)
    return BlobScene(gaussians, part, camera_set, pixels, labels)
