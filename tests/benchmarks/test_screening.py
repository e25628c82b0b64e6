"""Screening of variants on a GPU: the file of views, the table, refused names, and gsplat's pictures against ours."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.training.screening import gsplat_raster
from benchmarks.training.screening.__main__ import main, overview
from benchmarks.training.screening.views_file import read_views, write_views
from engine.errors import FormatError
from engine.events import ignore_events, never_stop
from engine.files import write_json
from engine.formats import SH_C0
from engine.rasterizer import rasterize
from engine.scene import CameraSet, PinholeCamera
from engine.training import start_gaussians, train
from engine.training.settings import PRESETS
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


def test_a_damaged_file_of_views_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "set.npz"
    write_views(file, *views_of_a_set())
    file.write_bytes(file.read_bytes()[:300])
    with pytest.raises(FormatError, match=r"set\.npz"):
        read_views(file)


def test_table_has_the_means_over_seeds(tmp_path: Path) -> None:
    for seed, psnr in ((0, 20.0), (1, 21.0)):
        figures = {"psnr": psnr, "ssim": 0.5, "dark_share": 0.01}
        write_json(tmp_path / f"banana16-growth-by-opacity-{seed}.json", figures)
    write_json(tmp_path / "skull66-no-features-0.json", {"psnr": 24.0, "ssim": 0.8, "dark_share": 0.1})
    assert overview(tmp_path).splitlines() == [
        "| PSNR dB | banana16 | skull66 |", "| --- | ---: | ---: |", "| no-features |  | 24.00 |",
        "| growth-by-opacity | 20.50 |  |",
    ]  # fmt: skip


def test_unknown_variants_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="no variant 'magic', only as-planned"):
        main(["train", str(tmp_path), "--variants", "magic"])
    with pytest.raises(SystemExit, match="has no views"):
        main(["train", str(tmp_path), "--variants", "no-features"])


def test_training_uses_the_other_rasterizer_and_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a gsplat that calls our rasterizer, and the CPU for the GPU."""
    n_pictures = 0

    def rasterization(means, quats, scales, opacities, values, viewmats, Ks, width, height, **options):
        nonlocal n_pictures
        n_pictures += 1
        camera = PinholeCamera(viewmats[0].double().numpy(), Ks[0].double().numpy(), width, height)
        raster = rasterize(means, quats, scales, opacities, camera=camera, channels=values, backend="reference")
        return raster.image[None], 1.0 - raster.transmittance[None, ..., None], {}

    def spherical_harmonics(degree, directions, coefficients):
        return coefficients[:, 0] * SH_C0

    fake = SimpleNamespace(rasterization=rasterization, spherical_harmonics=spherical_harmonics)
    monkeypatch.setitem(sys.modules, "gsplat", fake)
    monkeypatch.setattr(gsplat_raster, "DEVICE", "cpu")
    cameras, views = views_of_a_set()
    settings = PRESETS["test"].changed(steps=12, train_features=False, max_gaussians=60, held_out_every=3)
    start = start_gaussians(cameras, views, settings, emit=ignore_events)
    results = []
    for block in (gsplat_raster.gsplat_in_training(), contextlib.nullcontext()):
        with block:
            results.append(
                train(start, views, settings, checkpoints=tmp_path / f"{n_pictures}", emit=ignore_events,
                      should_stop=never_stop)
            )  # fmt: skip
    assert n_pictures > 12
    assert results[0].figures["psnr"] == pytest.approx(results[1].figures["psnr"], abs=0.05)


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
