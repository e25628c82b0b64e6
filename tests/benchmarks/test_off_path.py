"""Errors off the photos' path: what is a needle, what is a veil, and how the table is made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.training.off_path import (
    TrueView,
    needles,
    off_path_table,
    read_true_views,
    veil,
    write_true_views,
)
from engine.scene import CameraSet, Gaussians, PinholeCamera
from engine.training import TrainingView


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
        off_path = {"near": 24.0, "far": 27.0, "above": 25.0, "veil": 1.25, "views": 8}
        figures = {"psnr": psnr, "needles": 20.0, "off_path": off_path}
        results.append({"set": room, "run": "standard", "seed": 0, "figures": figures})
    results.append({"set": "banana16-640", "run": "standard", "seed": 0, "figures": {"psnr": 1.0}})
    rows = off_path_table(results).splitlines()
    assert rows[2:] == ["| standard | 2 | 16 of 18 | 1 | 31.00 | 24.00 | 27.00 | 25.00 | 25.33 | 1.2 | 20 |"]


def before_a_wall(depths: list[float], opacity: float = 0.5) -> dict[str, torch.Tensor]:
    """A wide opaque wall at depth 2, and a wide Gaussian of `opacity` at each of `depths`."""
    n = len(depths)
    return {
        "means": torch.tensor([[0.0, 0.0, 2.0], *([0.0, 0.0, depth] for depth in depths)]),
        "quats": torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n + 1, 1),
        # Ten times as wide as the picture: their opacity is that of their middle everywhere.
        "log_scales": torch.log(torch.tensor([[20.0, 20.0, 0.01]])).repeat(n + 1, 1),
        "opacity_logits": torch.logit(torch.tensor([0.98, *[opacity] * n])),
    }


def camera() -> PinholeCamera:
    return PinholeCamera(np.eye(4), np.array([[30.0, 0.0, 16.0], [0.0, 30.0, 12.0], [0.0, 0.0, 1.0]]), 32, 24)


@pytest.mark.parametrize(
    ("depths", "share"),
    # Each is 0.01 thick: 1.885 reaches 1.905, 0.95 of the depth is 1.9.
    [([], 0.0), ([1.0], 0.5), ([1.0, 1.5], 0.75), ([1.95], 0.0), ([1.885], 0.0), ([1.85], 0.5), ([2.5], 0.0)],
    ids=["nothing", "one", "two", "within 5 percent", "reaching into them", "beyond 5 percent", "behind"],
)
def test_a_veil_is_the_opacity_of_what_lies_before_the_true_surface(depths: list[float], share: float) -> None:
    true = np.full((24, 32), 2.0, np.float32)
    true[:, 16:] = 4.0  # so that places of several depths are compared
    found = veil(before_a_wall(depths), camera(), true)
    # 0.005: a wide Gaussian falls off by less at the edge of the picture.
    np.testing.assert_allclose(found[:, :16], share, atol=0.005)
    everything = 1 - 0.02 * 0.5 ** len(depths)
    np.testing.assert_allclose(found[:, 16:], everything, atol=0.005)


def test_true_views_are_read_as_they_were_written(tmp_path: Path) -> None:
    points = np.zeros((4, 3), np.float32)
    cameras = CameraSet((), (), points, np.zeros((4, 3), np.uint8), 0.5, np.eye(4), False)
    pixels = np.full((24, 32, 3), 90, np.uint8)
    valid = np.arange(24 * 32).reshape(24, 32) % 3 > 0
    depths = np.linspace(0, 5, 24 * 32, dtype=np.float32).reshape(24, 32)
    write_true_views(
        tmp_path / "room.npz", cameras, [TrueView(TrainingView("far_1", camera(), pixels, None, True, valid), depths)]
    )
    (read,) = read_true_views(tmp_path / "room.npz")
    assert read.view.photo == "far_1"
    np.testing.assert_array_equal(read.depths, depths)
    assert read.view.valid is not None
    np.testing.assert_array_equal(read.view.valid, valid)
