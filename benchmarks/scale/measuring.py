"""The cameras of one photo set: seconds of each step, memory, photos placed, and errors of their positions."""

from __future__ import annotations

import contextlib
import sqlite3
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from engine.cameras import estimate_cameras
from engine.cameras.settings import CameraSettings
from engine.core.arrays import Float64
from engine.core.events import Event, Progress
from engine.core.system import PeakMemory, cpu_seconds

from ..camera_health.running import distances_when_aligned
from .sets import SizedSet

STEPS = ("features", "pairs", "matching", "mapping", "checking")
_STEP_OF = {
    "copying the photos": "features",
    "features in": "features",
    "selecting pairs": "pairs",
    "pairs matched": "matching",
    "photos placed": "mapping",
    "checking": "checking",
}
"""Step by a part of the message while it goes on."""


@dataclass
class _Clock:
    """Wall and CPU seconds by step; a step lasts until a message of the next one, and is then told on stderr."""

    wall: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STEPS, 0.0))
    cpu: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STEPS, 0.0))
    step: str = "features"
    since: tuple[float, float] = field(default_factory=lambda: (time.perf_counter(), cpu_seconds()))

    def __call__(self, event: Event) -> None:
        if not isinstance(event, Progress):
            return
        now = time.perf_counter(), cpu_seconds()
        self.wall[self.step] += now[0] - self.since[0]
        self.cpu[self.step] += now[1] - self.since[1]
        self.since = now
        step = next((step for part, step in _STEP_OF.items() if part in event.message), self.step)
        if step != self.step:
            sys.stderr.write(f"{self.step}: {self.wall[self.step]:.1f} s ({self.cpu[self.step]:.0f} of CPU)\n")
        self.step = step


def measure(photos: SizedSet, folder: Path) -> dict[str, Any]:
    """Estimate the cameras as a user gets them, and return what it took and how good they are."""
    clock = _Clock()
    with PeakMemory.of() as peak:
        cameras = estimate_cameras(photos.photos, folder, CameraSettings(), emit=clock)
    clock(Progress("cameras", 1.0, None, ""))
    found = {camera.photo: camera.center for camera in cameras.cameras}
    health = "" if cameras.health is None else cameras.health.colour
    return {
        **_quality(found, photos),
        **_pairs(folder / "database.db"),
        "error_px": cameras.reprojection_error,
        "health": health,
        "wall": clock.wall,
        "cpu": clock.cpu,
        "peak_bytes": peak.bytes,
    }


def _quality(found: dict[str, Float64], photos: SizedSet) -> dict[str, Any]:
    """Return the photos placed, and the errors of their positions in shares of the diagonal of the true ones."""
    quality: dict[str, Any] = {
        "n_photos": len(photos.photos.photos), "n_placed": len(found), "median_error": None, "largest_error": None,
    }  # fmt: skip
    known = [name for name in found if name in photos.positions]
    if len(known) < 3:
        return quality
    every = np.array(list(photos.positions.values()))
    extent = float(np.linalg.norm(np.ptp(every, axis=0)))
    true = np.array([photos.positions[name] for name in known])
    left = distances_when_aligned(np.array([found[name] for name in known]), true) / extent
    return {**quality, "median_error": float(np.median(left)), "largest_error": float(left.max())}


def _pairs(database: Path) -> dict[str, int]:
    with contextlib.closing(sqlite3.connect(database)) as opened:
        rows = [rows for (rows,) in opened.execute("SELECT rows FROM two_view_geometries")]
    return {"n_pairs": len(rows), "n_verified": sum(count > 0 for count in rows)}
