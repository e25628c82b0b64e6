"""Errors off the photos' path: which pixels count, and how the table is made."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.training.off_path import needles, off_path_table
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


def test_a_run_is_a_row_with_means_over_rooms_and_seeds() -> None:
    results = []
    for room, psnr in (("room_1", 30.0), ("room_3", 32.0)):
        figures = {"psnr": psnr, "needles": 20.0, "off_path": {"near": 24.0, "far": 27.0, "above": 25.0}}
        results.append({"set": room, "run": "standard", "seed": 0, "figures": figures})
    results.append({"set": "banana16-640", "run": "standard", "seed": 0, "figures": {"psnr": 1.0}})
    rows = off_path_table(results).splitlines()
    assert rows[2:] == ["| standard | 2 | 1 | 31.00 | 24.00 | 27.00 | 25.00 | 25.33 | 20 |"]
