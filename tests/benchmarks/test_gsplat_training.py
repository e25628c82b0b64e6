"""The file of the views of a set, and training as gsplat does it."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.training import gsplat_training
from benchmarks.training.gsplat_training import train_gsplat
from benchmarks.training.views_file import read_views, write_views
from engine.core.errors import FormatError
from engine.rasterizer import rasterize
from engine.scene import CameraSet, Gaussians, PinholeCamera
from engine.training.views import TrainingView


def views_of_a_set() -> tuple[CameraSet, list[TrainingView]]:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3)).astype(np.float32)
    colors = rng.integers(0, 256, (20, 3)).astype(np.uint8)
    cameras = CameraSet((), (), points, colors, 0.5, np.eye(4), False)
    K = np.array([[30.0, 0.0, 16.0], [0.0, 30.0, 12.0], [0.0, 0.0, 1.0]])
    views = []
    for i in range(3):
        viewmat = np.eye(4)
        viewmat[2, 3] = 4.0 + i
        ramp = np.linspace(20 * i, 200, 24 * 32).reshape(24, 32, 1).repeat(3, axis=2).astype(np.uint8)
        views.append(TrainingView(f"{i}.jpg", PinholeCamera(viewmat, K, 32, 24), ramp, None, i == 1))
    return cameras, views


def test_views_are_read_as_they_were_written(tmp_path: Path) -> None:
    cameras, views = views_of_a_set()
    views[2] = replace(views[2], valid=views[2].pixels[..., 0] > 50)
    write_views(tmp_path / "set.npz", cameras, views)
    read_cameras, read = read_views(tmp_path / "set.npz")
    np.testing.assert_array_equal(read_cameras.points, cameras.points)
    np.testing.assert_array_equal(read_cameras.point_colors, cameras.point_colors)
    assert [view.photo for view in read] == ["0.jpg", "1.jpg", "2.jpg"]
    assert [view.held_out for view in read] == [False, True, False]
    for before, after in zip(views, read, strict=True):
        np.testing.assert_array_equal(after.pinhole.viewmat, before.pinhole.viewmat)
        np.testing.assert_array_equal(after.pinhole.K, before.pinhole.K)
        assert np.abs(after.pixels.astype(int) - before.pixels).max() <= 3
        np.testing.assert_array_equal(after.valid, before.valid)


def test_a_damaged_file_of_views_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "set.npz"
    write_views(file, *views_of_a_set())
    file.write_bytes(file.read_bytes()[:300])
    with pytest.raises(FormatError, match=r"set\.npz"):
        read_views(file)


@pytest.fixture
def n_pictures(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A gsplat that calls our rasterizer, and the CPU for the GPU; the pictures are counted."""
    counted = [0]

    def rasterization(
        means, quats, scales, opacities, values, viewmats, Ks, width, height, *, sh_degree=None, **options
    ):
        counted[0] += 1
        camera = PinholeCamera(viewmats[0].double().numpy(), Ks[0].double().numpy(), width, height)
        colors = {"channels": values} if sh_degree is None else {"sh": values, "sh_degree": sh_degree}
        raster = rasterize(means, quats, scales, opacities, camera=camera, backend="reference", **colors)
        return raster.image[None], 1.0 - raster.transmittance[None, ..., None], {}

    class Strategy:
        """No Gaussian is moved or added."""

        def __init__(self, **options: object) -> None: ...

        def check_sanity(self, values: object, optimizers: object) -> None: ...

        def initialize_state(self) -> dict[str, object]:
            return {}

        def step_post_backward(self, *arguments: object, **options: object) -> None: ...

    fake = SimpleNamespace(rasterization=rasterization)

    def fused_ssim(first, second, *, padding):
        assert first.shape == second.shape == (1, 3, 24, 32) and padding == "valid"
        return 1.0 - (first - second).square().mean()

    monkeypatch.setitem(sys.modules, "gsplat", fake)
    monkeypatch.setitem(sys.modules, "fused_ssim", SimpleNamespace(fused_ssim=fused_ssim))
    monkeypatch.setitem(sys.modules, "gsplat.strategy", SimpleNamespace(MCMCStrategy=Strategy))
    monkeypatch.setattr(gsplat_training, "DEVICE", "cpu")
    return counted


def test_gsplats_own_training_fits_the_training_photos(n_pictures: list[int]) -> None:
    cameras, views = views_of_a_set()

    def error(gaussians: Gaussians) -> float:
        values = [torch.from_numpy(getattr(gaussians, name)) for name in ("means", "quats", "log_scales")]
        opacities, sh = torch.from_numpy(gaussians.opacity_logits).sigmoid(), torch.from_numpy(gaussians.sh)
        image = rasterize(values[0], values[1], values[2].exp(), opacities, camera=views[0].pinhole, sh=sh).image
        return float((image - torch.from_numpy(views[0].pixels / 255.0)).abs().mean())

    few, many = (train_gsplat(cameras, views, steps=steps, max_gaussians=20, seed=0) for steps in (1, 80))
    assert n_pictures[0] == 81 and many.sh.shape == (20, 16, 3)
    assert np.allclose(np.linalg.norm(many.quats, axis=1), 1.0, atol=1e-5)
    assert error(many) < 0.9 * error(few)
