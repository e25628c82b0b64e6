"""A small generated scene: a textured floor and two walls, photographed by known cameras."""

from __future__ import annotations

import importlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.photos.reading import read_photos
from engine.scene.camera import Camera
from engine.scene.photo import PhotoSet

WIDTH, HEIGHT = 400, 300
LENS = (380.0, 200.0, 150.0, -0.08)


@dataclass(frozen=True)
class Scene:
    """Photos on disk and their true cameras."""

    photo_set: PhotoSet
    cameras: tuple[Camera, ...]


def looking_at(center: NDArray[np.float64], target: NDArray[np.float64], roll: float = 0.0) -> NDArray[np.float64]:
    """Return world-to-camera of a level camera (Z up), rolled by `roll` radians."""
    z = (target - center) / np.linalg.norm(target - center)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    rotation = np.stack([x, y, z])
    c, s = np.cos(roll), np.sin(roll)
    rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    viewmat = np.eye(4)
    viewmat[:3, :3] = rotation
    viewmat[:3, 3] = -rotation @ center
    return viewmat


def _texture(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    texture = np.zeros((512, 512))
    for cells in (16, 32, 64, 128):
        texture += np.kron(rng.standard_normal((cells, cells)), np.ones((512 // cells, 512 // cells)))
    return (texture - texture.min()) / (texture.max() - texture.min())


def render(camera: Camera, seed: int = 0) -> NDArray[np.uint8]:
    """Return the photo of `camera` of a room's corner: floor z = 0, walls x = 2 and y = 2, with different textures."""
    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=list(camera.params))
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    directions = lens.cam_from_img(np.stack([x.ravel(), y.ravel()], axis=1))
    rays = np.concatenate([directions, np.ones((len(directions), 1))], axis=1) @ camera.viewmat[:3, :3]
    picture = np.full((len(rays), 3), 128.0)
    nearest = np.full(len(rays), np.inf)
    for plane, (axis, level) in enumerate(((2, 0.0), (0, 2.0), (1, 2.0))):
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (level - camera.center[axis]) / rays[:, axis]
            hit = camera.center + distance[:, None] * rays
        uv = np.nan_to_num(np.delete(hit, axis, axis=1), nan=0.0, posinf=0.0, neginf=0.0)
        texture = _texture(10 * seed + plane)
        # Bilinear, so that the corners of the texture's squares have the same position in every view.
        at = np.clip((uv + 2.5) / 5.0, 0.0, 0.999) * 511
        low = np.floor(at).astype(int)
        part = at - low
        value = sum(
            texture[np.minimum(low[:, 0] + i, 511), np.minimum(low[:, 1] + j, 511)]
            * np.abs(1 - i - part[:, 0])
            * np.abs(1 - j - part[:, 1])
            for i in (0, 1)
            for j in (0, 1)
        )
        first = (distance > 0.0) & (distance < nearest)
        nearest[first] = distance[first]
        picture[first] = (255.0 * value[first])[:, None] * (1.0, 0.9 - 0.2 * plane, 0.6 + 0.2 * plane)
    return picture.reshape(camera.height, camera.width, 3).astype(np.uint8)


def room_cameras(count: int = 8) -> tuple[Camera, ...]:
    """Return level cameras on an arc in front of the corner."""
    cameras = []
    for index, angle in enumerate(np.radians(np.linspace(190.0, 260.0, count))):
        center = np.array([1.6, 1.6, 0.0]) + np.array(
            [3.2 * np.cos(angle), 3.2 * np.sin(angle), 1.3 + 0.1 * (index % 3)]
        )
        viewmat = looking_at(center, np.array([1.4, 1.4, 0.5]), roll=0.02 * (index % 3 - 1))
        cameras.append(Camera(f"{index:02d}.png", WIDTH, HEIGHT, "SIMPLE_RADIAL", LENS, viewmat))
    return tuple(cameras)


def make_scene(folder: Path, cameras: tuple[Camera, ...]) -> Scene:
    folder.mkdir(parents=True, exist_ok=True)
    for camera in cameras:
        (folder / camera.photo).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(render(camera)).save(folder / camera.photo)
    return Scene(read_photos(folder), cameras)


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Eight photos of the corner of a room, in a folder whose name has spaces and non-ASCII letters."""
    return make_scene(tmp_path_factory.mktemp("room") / "Fotos Müller 彫刻", room_cameras())


@pytest.fixture
def readers_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Call the readers of given cameras here, with JSON values as between processes: starting Python takes a second.

    `test_model_reading` and `test_given` read in a child process.
    """

    def call(function: str, arguments: dict[str, Any], **_: object) -> Any:
        module, _, name = function.partition(":")
        return json.loads(json.dumps(getattr(importlib.import_module(f"engine.{module}"), name)(**arguments)))

    monkeypatch.setattr("engine.cameras.model_reading.run_in_child", call)
