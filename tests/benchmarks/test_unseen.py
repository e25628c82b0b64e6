"""Errors off the photos' path: which pixels count, and how the table is made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.training.off_path import needles
from benchmarks.training.unseen import table
from engine.core.files import write_json
from engine.scene import Gaussians


def gaussians(log_scales: list[list[float]], opacity_logits: list[float]) -> Gaussians:
    n = len(log_scales)
    return Gaussians(
        means=np.zeros((n, 3), np.float32),
        quats=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        log_scales=np.array(log_scales, np.float32),
        opacity_logits=np.array(opacity_logits, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def test_visible_gaussians_longer_than_five_times_their_middle_axis_are_needles() -> None:
    five = float(np.log(5.0))
    shapes = [[five + 0.1, 0.0, -3.0], [five - 0.1, 0.0, -3.0], [0.0, 0.0, -9.0], [9.0, 0.0, 0.0]]
    assert needles(gaussians(shapes, [0.0, 0.0, 0.0, -9.0])) == pytest.approx(100 / 3)


def test_a_run_is_a_row_with_means_over_rooms_and_seeds(tmp_path: Path) -> None:
    for room, psnr in (("room_1", 30.0), ("room_3", 32.0)):
        off_path = {"near": 24.0, "far": 27.0, "above": 25.0}
        result = {"room": room, "run": "standard", "seed": 0, "psnr": psnr, "needles": 20.0, "off_path": off_path}
        write_json(tmp_path / f"{room}.json", result)
    assert table(tmp_path).splitlines()[2] == "| standard | 2 | 1 | 31.00 | 24.00 | 27.00 | 25.00 | 25.33 | 20 |"
