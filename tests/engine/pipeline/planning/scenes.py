"""Inputs of planning, made without any file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.cameras.settings import CameraSettings
from engine.photos.inspection import PhotoStatistics
from engine.pipeline.planning.decisions import PlanSettings, WorkPlan, plan_work
from engine.scene.camera import Camera, CameraSet
from engine.scene.photo import Photo, PhotoSet


def photos(n: int, *, width: int = 800, height: int = 600) -> PhotoSet:
    """Return `n` photos of one size."""
    return PhotoSet(Path("photos"), tuple(Photo(f"{i:03}.jpg", width, height, None, "") for i in range(n)), ())


def statistics(n: int) -> list[PhotoStatistics]:
    """Return the statistics of `n` equal photos."""
    return [PhotoStatistics(f"{i:03}.jpg", 0.5) for i in range(n)]


def work(n: int, settings: PlanSettings | None = None, *, poses_given: bool = False, **size: int) -> WorkPlan:
    """Return the plan of `n` equal photos."""
    return plan_work(
        photos(n, **size), statistics(n), settings or PlanSettings(), cameras=CameraSettings(), poses_given=poses_given,
        points_given=poses_given,
    )  # fmt: skip


def cameras(n: int) -> CameraSet:
    """Return a camera for each of `n` photos."""
    names = [f"{i:03}.jpg" for i in range(n)]
    registered = tuple(Camera(name, 800, 600, "PINHOLE", (700.0, 700.0, 400.0, 300.0), np.eye(4)) for name in names)
    points = np.zeros((0, 3), np.float32)
    return CameraSet(registered, (), points, points.astype(np.uint8), 0.5, np.eye(4), False)
