"""Screening of variants on a GPU: the file of views, the table, refused names, and gsplat's pictures against ours."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.training.screening import gsplat_raster, gsplat_training
from benchmarks.training.screening.__main__ import main, overview
from benchmarks.training.screening.gsplat_training import train_gsplat
from benchmarks.training.screening.views_file import read_views, write_views
from engine.core.errors import FormatError
from engine.core.events import ignore_events, never_stop
from engine.core.files import write_json
from engine.formats import SH_C0
from engine.rasterizer import rasterize
from engine.scene import CameraSet, Gaussians, PinholeCamera
from engine.training import start_gaussians, train
from engine.training.settings import PRESETS
from engine.training.views import TrainingView
from tests.conftest import PATIENCE, ROOT


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


def test_table_has_the_means_over_seeds(tmp_path: Path) -> None:
    for seed, psnr in ((0, 20.0), (1, 21.0)):
        figures = {"psnr": psnr, "fitted_psnr": psnr + 1, "ssim": 0.5, "dark_share": 0.01}
        write_json(tmp_path / f"banana16-growth-by-opacity-{seed}.json", figures)
    figures = {"psnr": 24.0, "fitted_psnr": 24.5, "ssim": 0.8, "dark_share": 0.1}
    write_json(tmp_path / "skull66-no-features-0.json", figures)
    write_json(tmp_path / "skull66-gsplat-0.json", figures)
    assert overview(tmp_path).splitlines() == [
        "| PSNR dB (fitted) | banana16 | skull66 |", "| --- | ---: | ---: |", "| no-features |  | 24.00 (24.50) |",
        "| growth-by-opacity | 20.50 (21.50) |  |", "| gsplat |  | 24.00 (24.50) |",
    ]  # fmt: skip


def test_unknown_variants_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="no variant 'magic', only as-planned"):
        main(["train", str(tmp_path), "--variants", "magic"])
    with pytest.raises(SystemExit, match="has no views"):
        main(["train", str(tmp_path), "--variants", "no-features"])


def test_a_machine_without_gpu_is_told_so_in_one_sentence_by_the_processes_that_train(tmp_path: Path) -> None:
    write_views(tmp_path / "set.npz", *views_of_a_set())
    command = [sys.executable, "-m", "benchmarks.training.screening", "train", str(tmp_path), "--variants", "gsplat"]
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env=environment, cwd=ROOT)
    assert done.returncode == 1
    assert done.stderr.strip() == "Screening needs an NVIDIA GPU and gsplat 1.5. Run it where both are."


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

    def spherical_harmonics(degree, directions, coefficients):
        return coefficients[:, 0] * SH_C0

    class Strategy:
        """No Gaussian is moved or added."""

        def __init__(self, **options: object) -> None: ...

        def check_sanity(self, values: object, optimizers: object) -> None: ...

        def initialize_state(self) -> dict[str, object]:
            return {}

        def step_post_backward(self, *arguments: object, **options: object) -> None: ...

    fake = SimpleNamespace(rasterization=rasterization, spherical_harmonics=spherical_harmonics)

    def fused_ssim(first, second, *, padding):
        assert first.shape == second.shape == (1, 3, 24, 32) and padding == "valid"
        return 1.0 - (first - second).square().mean()

    monkeypatch.setitem(sys.modules, "gsplat", fake)
    monkeypatch.setitem(sys.modules, "fused_ssim", SimpleNamespace(fused_ssim=fused_ssim))
    monkeypatch.setitem(sys.modules, "gsplat.strategy", SimpleNamespace(MCMCStrategy=Strategy))
    monkeypatch.setattr(gsplat_raster, "DEVICE", "cpu")
    monkeypatch.setattr(gsplat_training, "DEVICE", "cpu")
    return counted


def test_training_uses_the_other_rasterizer_and_loss(tmp_path: Path, n_pictures: list[int]) -> None:
    cameras, views = views_of_a_set()
    settings = PRESETS["test"].changed(steps=12, train_features=False, max_gaussians=60, held_out_every=3)
    start = start_gaussians(cameras, views, settings, emit=ignore_events)
    results = []
    for block in (gsplat_raster.gsplat_in_training(), contextlib.nullcontext()):
        with block:
            results.append(
                train(start, views, settings, checkpoints=tmp_path / f"{n_pictures[0]}", emit=ignore_events,
                      should_stop=never_stop)
            )  # fmt: skip
    assert n_pictures[0] > 12
    assert results[0].figures["psnr"] == pytest.approx(results[1].figures["psnr"], abs=0.05)


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


@pytest.mark.gpu
def test_gsplat_gives_the_picture_of_our_rasterizer() -> None:
    generator = torch.Generator().manual_seed(0)
    n = 200
    means = torch.randn(n, 3, generator=generator) * 0.5
    quats = torch.nn.functional.normalize(torch.randn(n, 4, generator=generator), dim=1)
    scales = torch.rand(n, 3, generator=generator) * 0.1 + 0.02
    opacities = torch.rand(n, generator=generator) * 0.8 + 0.1
    sh = torch.randn(n, 4, 3, generator=generator) * 0.3
    camera = views_of_a_set()[1][0].pinhole
    ours = rasterize(means, quats, scales, opacities, camera=camera, sh=sh)
    with gsplat_raster.gsplat_in_training():
        theirs = rasterize(means, quats, scales, opacities, camera=camera, sh=sh)
    assert float((ours.image - theirs.image).abs().max()) < 0.02
    assert float((ours.transmittance - theirs.transmittance).abs().max()) < 0.02
