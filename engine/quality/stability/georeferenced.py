"""Scenes whose origin is hundreds of kilometres away: in float32 as they are, and normalised as in the pipeline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from ...cameras import normalised_viewmat, original_from_world
from ...core.arrays import Float64
from ...scene import PinholeCamera
from .bounds import Bounds
from .measure import Finding
from .scenes import Scene, facing_camera, ordinary_scene


def _offset(origin: float) -> Float64:
    """Return the position of the scene, about `origin` metres east and north, not on a round float32 number."""
    return origin * np.array([1.0, 0.9, 0.01]) + np.array([0.137, 0.271, 0.052])


def _moved_camera(offset: Float64, camera: PinholeCamera) -> PinholeCamera:
    viewmat = camera.viewmat.copy()
    viewmat[:3, 3] -= viewmat[:3, :3] @ offset
    return replace(camera, viewmat=viewmat)


def unnormalised_case(origin: float) -> Callable[[Bounds], Finding]:
    """Return a case that measures how far, in metres, Gaussians are rendered from their true positions.

    Twelve Gaussians 10 m in front of the camera are rendered one by one. The centre of each in float32 is compared with
    that in float64, where the means keep all digits.
    """

    def run(bounds: Bounds) -> Finding:
        offset = _offset(origin)
        camera = _moved_camera(offset, facing_camera(40, 30))
        rng = np.random.default_rng(4)
        worst = 0.0
        for _ in range(12):
            local = rng.uniform([-0.5, -0.5, 9.9], [0.5, 0.5, 10.1])
            gaussian = replace(
                ordinary_scene(1, camera=camera), sh=torch.zeros(1, 1, 3, dtype=torch.float64)
            ).with_arrays(scales=np.full((1, 3), 0.3), opacities=[0.9], channels=np.ones((1, 1)))
            moved = replace(gaussian, means=torch.tensor(local + offset)[None])
            ours, truth = moved.cast(torch.float32).render("cpu"), moved.cast(torch.float64).render("reference")
            pixels = _centroid(ours.image) - _centroid(truth.image)
            worst = max(worst, float(np.hypot(*pixels)) * local[2] / camera.K[0, 0])
        problems = [] if worst <= bounds.forward else [f"a Gaussian is rendered {worst:.2g} m from its true position"]
        return Finding("bounded", forward=worst, problems=tuple(problems))

    return run


def _centroid(image: torch.Tensor) -> Float64:
    """Return the centre of mass of the last channel in pixels, (x, y)."""
    weights = image[..., -1].detach().double().numpy()
    ys, xs = np.mgrid[: weights.shape[0], : weights.shape[1]] + 0.5
    return np.array([(weights * xs).sum(), (weights * ys).sum()]) / weights.sum()


def normalised_scene(origin: float) -> Scene:
    """Return an ordinary scene with five cameras, moved by `origin` metres and then normalised by `cameras.normalise`.

    Its means and scales keep the digits that they have in float64: the error of the picture includes their rounding to
    float32 after normalising.
    """
    offset = _offset(origin)
    scene = ordinary_scene()
    angles = np.linspace(-0.6, 0.6, 5)
    viewmats = []
    for angle in angles:
        # 3 m from the middle of the scene. The first camera renders.
        viewmat = np.eye(4)
        c, s = np.cos(angle), np.sin(angle)
        viewmat[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
        middle = np.array([0.0, 0.0, 3.0])
        viewmat[:3, 3] = np.array([0.0, 0.0, 3.0]) - viewmat[:3, :3] @ (middle + offset)
        viewmats.append(viewmat)
    points = scene.means.numpy() + offset
    similarity = original_from_world(viewmats, points)
    size = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    local = (points - similarity[:3, 3]) @ np.linalg.inv(similarity[:3, :3]).T
    k = facing_camera().K
    camera = PinholeCamera(normalised_viewmat(viewmats[0], similarity), k, 40, 30)
    return replace(scene, means=torch.tensor(local), scales=scene.scales / size, camera=camera)
