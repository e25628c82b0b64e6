"""Files of other programs are imported as they are meant, and leave Blender with what they said."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part
from mathutils import Vector

RandomGaussians = Callable[..., Any]
FILES = Path(os.environ["GAUSSIAN_HERITAGE_FIXTURES"]) / "formats"
UTM = (500_123.0, 4_649_876.0, 35.0)


def imported(path: Path, **options: Any) -> bpy.types.Object:
    assert bpy.ops.heritage.import_gaussian_ply(filepath=str(path), **options) == {"FINISHED"}
    bpy.context.view_layer.update()
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def exported(folder: Path, kind: str = "ply", **options: Any) -> Path:
    bpy.ops.heritage.export_objects(directory=str(folder), scope="SCENE", format=kind.upper(), **options)
    return next(folder.glob(f"*.{kind}"))


def write_doubles(path: Path, gaussians: Any, places: np.ndarray) -> None:
    """Write a PLY with double coordinates, as CloudCompare does."""
    names = [
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        "opacity",
        *(f"scale_{i}" for i in range(3)),
        *(f"rot_{i}" for i in range(4)),
    ]
    rows = np.zeros(len(places), [(name, "<f8") for name in "xyz"] + [(name, "<f4") for name in names])
    for axis, name in enumerate("xyz"):
        rows[name] = places[:, axis]
    for i in range(3):
        rows[f"f_dc_{i}"], rows[f"scale_{i}"] = gaussians.sh[:, 0, i], gaussians.log_scales[:, i]
    for i in range(4):
        rows[f"rot_{i}"] = gaussians.quats[:, i]
    rows["opacity"] = gaussians.opacity_logits
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [*(f"property double {name}" for name in "xyz"), *(f"property float {name}" for name in names)]
    path.write_bytes("\n".join([*header, "end_header", ""]).encode() + rows.tobytes())


def places_in(path: Path) -> np.ndarray:
    data = path.read_bytes()
    lines = data[: data.index(b"end_header")].decode().split("\n")
    kinds = {"double": "<f8", "float": "<f4"}
    dtype = [(line.split()[2], kinds[line.split()[1]]) for line in lines if line.startswith("property")]
    rows = np.frombuffer(data[data.index(b"end_header\n") + 11 :], dtype)
    return np.stack([rows[name].astype(np.float64) for name in "xyz"], axis=1)


@pytest.mark.parametrize("up", ["-y", "z"])
def test_utm_coordinates_keep_their_digits_and_come_back(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, up: str
) -> None:
    gaussians = random_gaussians(200, degree=0)
    places = np.random.default_rng(0).uniform(-5, 5, (200, 3)) + UTM
    write_doubles(tmp_path / "scene.ply", gaussians, places)
    obj = imported(tmp_path / "scene.ply", up=up)
    axis = {"-y": (UTM[0], 0, -UTM[1]), "z": UTM}[up]
    # Height is near 0 beside the extent of ten metres, so only what is far goes into the location.
    np.testing.assert_allclose(
        np.array(obj.location)[[0, 1 if up == "z" else 2]], np.array(axis)[[0, 1 if up == "z" else 2]], atol=1
    )
    own = np.array([vertex.co for vertex in obj.data.vertices], np.float64)
    np.testing.assert_allclose(own - own.mean(axis=0), places - places.mean(axis=0), atol=1e-5)
    # Without a record, the file is as it was; with one, its places are.
    assert exported(tmp_path / "same", with_record=False).read_bytes() == (tmp_path / "scene.ply").read_bytes()
    back = places_in(exported(tmp_path / "out"))
    turned = places if up == "-y" else places[:, [0, 2, 1]] * (1, -1, 1)
    np.testing.assert_allclose(back, turned, atol=1e-5)
    # Two objects as one file.
    bpy.ops.object.select_all(action="SELECT")
    copy = obj.copy()
    copy.location.x += 20
    bpy.context.scene.collection.objects.link(copy)
    copy.select_set(True)
    bpy.context.view_layer.update()
    assert bpy.ops.heritage.export_splats(filepath=str(tmp_path / "both.ply")) == {"FINISHED"}
    both = places_in(tmp_path / "both.ply")
    np.testing.assert_allclose(np.sort(both[:, 0])[:200], np.sort(places[:, 0]), atol=1e-4)
    for kind in ("glb", "spz", "sog"):
        with pytest.raises(RuntimeError, match="cannot hold their places"):
            exported(tmp_path / kind, kind)
    assert exported(tmp_path / "near", "glb", origin="OBJECT").is_file()


@pytest.mark.parametrize("kind", ["ply", "glb", "spz", "sog"])
def test_anti_aliased_training_is_kept_in_every_format(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, kind: str
) -> None:
    formats = part("engine.formats")
    formats.write_ply(tmp_path / "scene.ply", replace(random_gaussians(30), antialiased=True))
    obj = imported(tmp_path / "scene.ply")
    assert part("gaussian_heritage_addon.splats.splats").SplatScene.of(obj).is_antialiased
    file = exported(tmp_path / "out", kind)
    bpy.data.objects.remove(obj)
    again = imported(file)
    assert part("gaussian_heritage_addon.splats.splats").SplatScene.of(again).local_gaussians().antialiased


def test_anti_aliased_splats_and_others_do_not_leave_as_one_file(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path
) -> None:
    formats = part("engine.formats")
    for name, antialiased in (("a", True), ("b", False)):
        formats.write_ply(tmp_path / f"{name}.ply", replace(random_gaussians(5), antialiased=antialiased))
        bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / f"{name}.ply"))
    for name in ("a", "b"):
        bpy.data.objects[name].select_set(True)
    with pytest.raises(RuntimeError, match="cannot be put together"):
        bpy.ops.heritage.export_splats(filepath=str(tmp_path / "both.ply"))


def test_sog_of_playcanvas_is_read_as_its_program_reads_it(part: Part, tmp_path: Path) -> None:
    # playcanvas.sog.ply is what splat-transform makes of playcanvas.sog.
    expected = part("engine.formats").read_ply_file(FILES / "playcanvas.sog.ply").gaussians
    imported(FILES / "playcanvas.sog", up="z")
    back = part("engine.formats").read_ply(exported(tmp_path))
    for name in ("means", "log_scales", "sh"):
        np.testing.assert_allclose(getattr(back, name), getattr(expected, name), atol=2e-6, err_msg=name)
    np.testing.assert_allclose(back.opacities, expected.opacities, atol=1e-5)


def test_sog_leaves_and_comes_back(part: Part, random_gaussians: RandomGaussians, tmp_path: Path) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(300, degree=2)
    formats.write_ply(tmp_path / "scene.ply", gaussians, up="z")
    obj = imported(tmp_path / "scene.ply")
    file = exported(tmp_path / "out", "sog")
    bpy.data.objects.remove(obj)
    back = part("gaussian_heritage_addon.splats.splats").SplatScene.of(imported(file)).local_gaussians()
    assert not [image for image in bpy.data.images if "SOG" in image.name or "picture" in image.name]
    order = np.argsort(gaussians.means[:, 0]), np.argsort(back.means[:, 0])
    np.testing.assert_allclose(back.means[order[1]], gaussians.means[order[0]], atol=1e-3)
    # 256 numbers for 900 log-scales; those of 8 bits of opacities.
    np.testing.assert_allclose(back.log_scales[order[1]], gaussians.log_scales[order[0]], atol=0.2)
    np.testing.assert_allclose(back.opacities[order[1]], gaussians.opacities[order[0]], atol=0.51 / 255)


@pytest.mark.parametrize("name", ["playcanvas.spz", "level_1.ksplat", "gsplat.splat"])
def test_files_of_the_web_are_imported(part: Part, tmp_path: Path, name: str) -> None:
    source = FILES / ("niantic_4.spz" if name.endswith(".spz") else name)
    shutil.copyfile(source, tmp_path / name)
    obj = imported(tmp_path / name)
    assert len(obj.data.vertices) == 7
    if not name.endswith(".spz"):
        mean = part("engine.formats").read_ply_file(FILES / "niantic_3.ply").gaussians.means.mean(axis=0)
        place = obj.matrix_world @ Vector(np.mean([vertex.co for vertex in obj.data.vertices], axis=0))
        np.testing.assert_allclose(tuple(place), (mean[0], mean[2], -mean[1]), atol=1e-3)


def test_a_file_is_known_by_its_content(part: Part, random_gaussians: RandomGaussians, tmp_path: Path) -> None:
    part("engine.formats").write_ply(tmp_path / "scene.splat", random_gaussians(9))
    assert len(imported(tmp_path / "scene.splat").data.vertices) == 9


def test_what_a_damaged_sog_is_told_by_one_sentence(part: Part, tmp_path: Path) -> None:
    data = (FILES / "playcanvas.sog").read_bytes()
    (tmp_path / "scene.sog").write_bytes(data[: len(data) // 2])
    with pytest.raises(RuntimeError, match="scene.sog"):
        bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / "scene.sog"))


def test_2d_gaussians_are_named(part: Part, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [
        "x",
        "y",
        "z",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        "opacity",
        "scale_0",
        "scale_1",
        *(f"rot_{i}" for i in range(4)),
    ]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "element vertex 4",
        *(f"property float {name}" for name in names),
    ]
    rows = np.random.default_rng(0).normal(size=(4, len(names))).astype("<f4")
    (tmp_path / "flat.ply").write_bytes("\n".join([*header, "end_header", ""]).encode() + rows.tobytes())
    obj = imported(tmp_path / "flat.ply")
    assert "2D Gaussians (2DGS)" in capsys.readouterr().out
    assert [round(entry.vector[2] * 1e6) for entry in obj.data.attributes["scale"].data] == [1] * 4
    assert exported(tmp_path / "out", with_record=False).read_bytes() == (tmp_path / "flat.ply").read_bytes()
