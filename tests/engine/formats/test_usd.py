"""USD files hold the Gaussians in the attributes of OpenUSD's own schema, and say what their unit is."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import DiskError, EnvironmentProblem, FormatError, NumericalError
from engine.formats.facts import FileFacts
from engine.formats.usd import PRIM_TYPE, write_usd
from engine.formats.usd_elsewhere import write_usd_elsewhere
from engine.formats.usd_reading import read_usd
from engine.scene import rotations_from_quats

from .conftest import RandomGaussians

pxr_usd = pytest.importorskip("pxr.Usd", reason="usd-core is optional: requirements/formats.txt")


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_the_stage_has_one_prim_with_all_values(tmp_path: Path, suffix: str, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(6, degree=2)
    path = tmp_path / f"a{suffix}"
    write_usd(path, gaussians, FileFacts("Ölkanne", metres_per_unit=0.25, extras={"title": "Ölkanne"}))
    stage = pxr_usd.Stage.Open(str(path))
    layer = stage.GetRootLayer()
    assert stage.GetMetadata("metersPerUnit") == 0.25 and stage.GetMetadata("upAxis") == "Z"
    assert layer.customLayerData["title"] == "Ölkanne" and "unit" not in layer.customLayerData
    prim = stage.GetDefaultPrim()
    assert prim.GetTypeName() == PRIM_TYPE and prim.GetDisplayName() == "Ölkanne"

    def get(name: str) -> np.ndarray:
        return np.array(prim.GetAttribute(name).Get())

    np.testing.assert_array_equal(get("positions"), gaussians.means)
    np.testing.assert_array_equal(get("scales"), gaussians.scales)
    np.testing.assert_array_equal(get("opacities"), gaussians.opacities)
    np.testing.assert_array_equal(get("radiance:sphericalHarmonicsCoefficients"), gaussians.sh.reshape(-1, 3))
    assert prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get() == 2
    quats = np.array([[one.real, *one.imaginary] for one in prim.GetAttribute("orientations").Get()], np.float32)
    np.testing.assert_allclose(rotations_from_quats(quats), rotations_from_quats(gaussians.quats), atol=1e-6)
    low, high = get("extent")
    assert (low <= gaussians.means.min(axis=0)).all() and (high >= gaussians.means.max(axis=0)).all()


def test_an_unknown_unit_is_said_and_the_photos_that_saw_each_gaussian_are_kept(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    write_usd(tmp_path / "a.usdc", random_gaussians(3, degree=0), FileFacts(seen=np.array([0, 7, 2])))
    stage = pxr_usd.Stage.Open(str(tmp_path / "a.usdc"))
    # USD's own default, 0.01, would show the Gaussians 100 times too small.
    assert stage.GetMetadata("metersPerUnit") == 1.0
    assert "unit of this file is unknown" in stage.GetRootLayer().documentation
    assert stage.GetRootLayer().customLayerData["unit"] == "unknown"
    assert list(stage.GetDefaultPrim().GetAttribute("primvars:photosSeen").Get()) == [0, 7, 2]


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_written_gaussians_are_read_back(tmp_path: Path, suffix: str, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(6, degree=3)
    write_usd(tmp_path / f"a{suffix}", gaussians)
    back = read_usd(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(back.means, gaussians.means)
    np.testing.assert_array_equal(back.sh, gaussians.sh)
    # The file has scales and opacities: one rounding of float32 each.
    np.testing.assert_allclose(back.log_scales, gaussians.log_scales, atol=1e-6)
    np.testing.assert_allclose(back.opacities, gaussians.opacities, atol=1e-6)
    np.testing.assert_allclose(rotations_from_quats(back.quats), rotations_from_quats(gaussians.quats), atol=1e-6)


def test_a_file_with_y_up_and_a_moved_parent_is_read_where_it_is_shown(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(6, degree=1)
    write_usd(tmp_path / "a.usda", gaussians)
    text = (tmp_path / "a.usda").read_text(encoding="utf-8")
    text = text.replace('upAxis = "Z"', 'upAxis = "Y"').replace(
        "    uniform token projectionModeHint",
        '    double3 xformOp:translate = (1, 2, 3)\n    uniform token[] xformOpOrder = ["xformOp:translate"]\n'
        "    uniform token projectionModeHint",
    )
    (tmp_path / "a.usda").write_text(text)
    x, y, z = (gaussians.means + (1, 2, 3)).T
    np.testing.assert_allclose(read_usd(tmp_path / "a.usda").means, np.stack([x, -z, y], axis=1), atol=1e-6)


def test_other_usd_files_are_refused_with_a_reason(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    write_usd(tmp_path / "good.usda", random_gaussians(3, degree=0))
    good = (tmp_path / "good.usda").read_text(encoding="utf-8")
    head, _, body = good.partition("def ")
    for content, sentence in (
        ("not USD", "is not a USD file with Gaussians that can be read"),
        ("#usda 1.0\n", "has 0 prims of the type ParticleField3DGaussianSplat"),
        (good + body.join(["\ndef ", ""]).replace('"Gaussians"', '"More"', 1), "has 2 prims"),
        ("#usda 1.0\n(\n    subLayers = [@/etc/passwd@]\n)\n", "takes parts from other files"),
        (good.replace("point3f[] positions", "point3f[] others"), "it has no positions"),
        (good.replace("sphericalHarmonicsDegree = 0", "sphericalHarmonicsDegree = 3"), "cannot reshape"),
    ):
        (tmp_path / "a.usda").write_text(content)
        with pytest.raises(FormatError, match=sentence):
            read_usd(tmp_path / "a.usda")
    data = bytearray(good.encode())
    data[len(head) + 2] = 0xFF
    (tmp_path / "a.usda").write_bytes(data)
    with pytest.raises(FormatError, match="can be read"):
        read_usd(tmp_path / "a.usda")
    with pytest.raises(FormatError, match="cannot be read"):
        read_usd(tmp_path / "none.usda")


def test_a_file_is_replaced_whole_or_not_at_all(
    tmp_path: Path, random_gaussians: RandomGaussians, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.usdc"
    path.write_text("precious")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(DiskError, match=r"Could not write .*a\.usdc: No space left on device"):
            write_usd(path, random_gaussians(3))
    broken = random_gaussians(3)
    broken.sh[0, 0, 0] = np.nan
    with pytest.raises(NumericalError, match="`sh` are not finite"):
        write_usd(path, broken)
    assert path.read_text(encoding="utf-8") == "precious" and [one.name for one in tmp_path.iterdir()] == ["a.usdc"]
    write_usd(path, random_gaussians(3))
    assert pxr_usd.Stage.Open(str(path)).GetDefaultPrim()


def test_an_openusd_that_is_missing_or_too_old_is_said(
    tmp_path: Path, random_gaussians: RandomGaussians, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("engine.formats.usd.PRIM_TYPE", "ParticleFieldOfTheFuture")
        with pytest.raises(EnvironmentProblem, match=r"OpenUSD [\d.]+ does not know ParticleFieldOfTheFuture"):
            write_usd(tmp_path / "a.usdc", random_gaussians(1))
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pxr", None)
        with pytest.raises(EnvironmentProblem, match="need the package usd-core, which is not installed"):
            write_usd(tmp_path / "a.usdc", random_gaussians(1))
    assert list(tmp_path.iterdir()) == []


def test_another_python_writes_the_same_file(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = replace(random_gaussians(6, degree=2), antialiased=True)
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    facts = FileFacts("Ölkanne", matrix=matrix, extras={"record": {"title": "Ölkanne"}})
    write_usd(tmp_path / "here.usda", gaussians, facts)
    write_usd_elsewhere(Path(sys.executable), tmp_path / "there.usda", gaussians, facts)
    assert (tmp_path / "there.usda").read_text(encoding="utf-8") == (tmp_path / "here.usda").read_text(encoding="utf-8")


def test_another_python_that_cannot_start_is_told_in_one_sentence(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    with pytest.raises(DiskError, match=r"a\.usd was not written: .* Export GLB, PLY or SPZ instead\."):
        write_usd_elsewhere(tmp_path / "no python", tmp_path / "a.usd", random_gaussians(2))
