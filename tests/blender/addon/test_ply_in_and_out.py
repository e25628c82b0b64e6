"""A Gaussian PLY is imported and exported again; changes made in Blender are in the exported file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part
from mathutils import Matrix, Quaternion, Vector

RandomGaussians = Callable[..., Any]


def import_ply(path: Path, **options: Any) -> bpy.types.Object:
    assert bpy.ops.heritage.import_gaussian_ply(filepath=str(path), **options) == {"FINISHED"}
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def export(folder: Path, **options: Any) -> None:
    assert bpy.ops.heritage.export_objects(**{"directory": str(folder), "format": "PLY", **options}) == {"FINISHED"}


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_unchanged_scene_is_exported_unchanged(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, degree: int
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(50, degree=degree)
    formats.write_ply(tmp_path / "scene.ply", gaussians)
    import_ply(tmp_path / "scene.ply")
    export(tmp_path / "out", scope="SCENE")
    back = formats.read_ply_file(tmp_path / "out" / "scene.ply").gaussians
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(back, name), getattr(gaussians, name), err_msg=name)


def test_attributes_have_the_names_and_types_of_blenders_own_splats(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path
) -> None:
    gaussians = random_gaussians(5, degree=1)
    part("engine.formats").write_ply(tmp_path / "scene.ply", gaussians)
    attributes = import_ply(tmp_path / "scene.ply").data.attributes
    base = "FLOAT4" if bpy.app.version >= (5, 2, 0) else "FLOAT_COLOR"
    expected = {"rotation": "QUATERNION", "scale": "FLOAT_VECTOR", "radiance:base": base, "gaussian_index": "INT"}
    expected |= {f"radiance:sh_{k}": "FLOAT_VECTOR" for k in range(3)}
    assert {name: attributes[name].data_type for name in expected} == expected
    np.testing.assert_allclose(tuple(attributes["scale"].data[2].vector), gaussians.scales[2], rtol=1e-6)
    np.testing.assert_allclose(tuple(attributes["radiance:sh_2"].data[4].vector), gaussians.sh[4, 3], rtol=1e-6)


@pytest.mark.parametrize(("suffix", "exact"), [("glb", 1e-6), ("spz", 0.05)])
def test_spz_and_glb_are_imported_upright(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, suffix: str, exact: float
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(20, degree=1)
    getattr(formats, f"write_{suffix}")(tmp_path / f"scene.{suffix}", gaussians)
    obj = import_ply(tmp_path / f"scene.{suffix}")
    assert obj.name == "scene" and len(obj.data.vertices) == 20
    export(tmp_path / "out", scope="SCENE")
    back = formats.read_ply(tmp_path / "out" / "scene.ply")
    np.testing.assert_allclose(back.means, gaussians.means, atol=exact)
    np.testing.assert_allclose(back.log_scales, gaussians.log_scales, atol=exact)


@pytest.mark.parametrize(("name", "said"), [("empty.glb", "no Gaussians"), ("scene.abc", "none of PLY, SPZ")])
def test_a_file_without_gaussians_or_of_another_format_is_refused(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, name: str, said: str
) -> None:
    nothing = random_gaussians(3)[:0] if name.endswith(".glb") else None
    if nothing is None:
        (tmp_path / name).write_bytes(b"abc")
    else:
        part("engine.formats").write_glb(tmp_path / name, nothing)
    with pytest.raises(RuntimeError, match=said):
        bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / name))
    assert not [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]


@pytest.mark.parametrize("file_format", ["PLY", "GLB"])
def test_placement_in_blender_is_in_the_file(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, file_format: str
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(20)
    formats.write_ply(tmp_path / "scene.ply", gaussians)
    matrix = Matrix.LocRotScale((1, 2, 3), Quaternion((0.2, -0.5, 0.7, 0.3)).normalized(), (2, 2, 2))
    import_ply(tmp_path / "scene.ply").matrix_world = matrix
    bpy.context.view_layer.update()
    export(tmp_path, scope="SCENE", format=file_format, overwrite=True)
    read = formats.read_ply if file_format == "PLY" else formats.read_glb
    back = read(tmp_path / f"scene.{file_format.lower()}")
    expected = formats.transform_gaussians(gaussians, np.array(matrix))
    np.testing.assert_allclose(back.means, expected.means, atol=2e-6)
    np.testing.assert_allclose(back.sh, expected.sh, atol=3e-6)
    np.testing.assert_allclose(back.log_scales, expected.log_scales, atol=2e-6)


def test_vertices_deleted_in_blender_are_not_exported(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(10)
    formats.write_ply(tmp_path / "scene.ply", gaussians)
    obj = import_ply(tmp_path / "scene.ply")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.data.vertices[3].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    export(tmp_path / "out", scope="SCENE")
    bpy.ops.object.mode_set(mode="OBJECT")
    back = formats.read_ply_file(tmp_path / "out" / "scene.ply").gaussians
    np.testing.assert_array_equal(back.means, np.delete(gaussians.means, 3, axis=0))
    np.testing.assert_array_equal(back.sh, np.delete(gaussians.sh, 3, axis=0))


def test_existing_files_are_replaced_only_on_request(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path
) -> None:
    path = tmp_path / "scene.ply"
    part("engine.formats").write_ply(path, random_gaussians(3))
    before = path.read_bytes()
    import_ply(path)
    with pytest.raises(RuntimeError, match=r"already contains scene\.ply"):
        bpy.ops.heritage.export_objects(directory=str(tmp_path), format="PLY", scope="SCENE")
    assert path.read_bytes() == before
    export(tmp_path, scope="SCENE", overwrite=True)
    assert b"generator Gaussian Heritage" in path.read_bytes()


def test_ordinary_point_cloud_is_a_clear_error(blender: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "cloud.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n" + bytes(12)
    )
    with pytest.raises(RuntimeError, match="looks like an ordinary point cloud"):
        bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / "cloud.ply"))
    assert len(bpy.data.objects) == 0


def test_nothing_to_export_is_a_clear_error(blender: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="nothing to export"):
        bpy.ops.heritage.export_objects(directory=str(tmp_path))


@pytest.mark.parametrize("up", ["-y", "z", "y", None])
@pytest.mark.parametrize("degree", [0, 3])
def test_untouched_file_leaves_blender_byte_for_byte(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, degree: int, up: str | None
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(500, degree=degree)
    photos = {"photos_seen": np.arange(500) % 40}
    formats.write_ply(tmp_path / "scene.ply", gaussians, up=up, extra=photos, comments=["title Vase"])
    import_ply(tmp_path / "scene.ply")
    export(tmp_path / "out", scope="SCENE", with_record=False)
    assert (tmp_path / "scene.ply").read_bytes() == (tmp_path / "out" / "scene.ply").read_bytes()


def test_edited_gaussians_and_deleted_ones_are_respected_and_the_others_keep_their_bits(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(50)
    formats.write_ply(tmp_path / "scene.ply", gaussians, up="-y", extra={"photos_seen": np.arange(50)})
    obj = import_ply(tmp_path / "scene.ply")
    before = formats.read_ply_file(tmp_path / "scene.ply")
    obj.data.attributes["scale"].data[7].vector = (0.5, 0.25, 0.125)
    obj.data.attributes["position"].data[8].vector = (1, 2, 3)
    export(tmp_path / "out", scope="SCENE", with_record=False)
    after = formats.read_ply_file(tmp_path / "out" / "scene.ply")
    np.testing.assert_allclose(after.gaussians.scales[7], (0.5, 0.25, 0.125), rtol=1e-6)
    assert after.gaussians.means[8].tolist() == [1, 2, 3]
    others = np.delete(np.arange(50), [7, 8])
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        stored, wanted = getattr(after.gaussians, name), getattr(before.gaussians, name)
        np.testing.assert_array_equal(stored[others], wanted[others], err_msg=name)
    assert after.extra["photos_seen"].tolist() == list(range(50))


@pytest.mark.parametrize(("options", "axis"), [({}, (0, -1, 0)), ({"up": "z"}, (0, 0, 1)), ({"up": "y"}, (0, 1, 0))])
def test_a_file_of_another_program_stands_upright(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, options: dict[str, str], axis: tuple[int, ...]
) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(20)
    formats.write_ply(tmp_path / "scene.ply", gaussians)
    # In the files of most programs, Y points down.
    obj = import_ply(tmp_path / "scene.ply", **options)
    np.testing.assert_allclose(obj.matrix_world @ Vector(axis), (0, 0, 1), atol=1e-6)


@pytest.mark.parametrize("kind", ["ply", "glb", "spz"])
def test_objects_of_a_collection_leave_as_one_file_by_its_exporter(
    part: Part, random_gaussians: RandomGaussians, tmp_path: Path, kind: str
) -> None:
    formats = part("engine.formats")
    collection = bpy.data.collections.new("Vases")
    bpy.context.scene.collection.children.link(collection)
    for number, degree in enumerate((1, 3)):
        formats.write_ply(tmp_path / f"{number}.ply", random_gaussians(10 + number, degree=degree, seed=number), up="z")
        bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / f"{number}.ply"))
        obj = bpy.data.objects[str(number)]
        bpy.context.scene.collection.objects.unlink(obj)
        collection.objects.link(obj)
    bpy.data.objects["1"].location.x = 10
    bpy.context.view_layer.update()
    file = tmp_path / f"vases.{kind}"
    assert bpy.ops.heritage.export_splats(filepath=str(file), collection="Vases") == {"FINISHED"}
    back = {"ply": formats.read_ply, "glb": formats.read_glb, "spz": formats.read_spz}[kind](file)
    assert len(back) == 21 and back.sh_degree == 3
    assert (back.means[:, 0] > 5).sum() == 11
    layer = bpy.context.view_layer.layer_collection.children["Vases"]
    bpy.context.view_layer.active_layer_collection = layer
    assert bpy.ops.collection.exporter_add(name="HERITAGE_FH_export_splats") == {"FINISHED"}


def test_an_objects_file_may_have_its_own_origin(part: Part, random_gaussians: RandomGaussians, tmp_path: Path) -> None:
    formats, gaussians = part("engine.formats"), random_gaussians(20)
    formats.write_ply(tmp_path / "scene.ply", gaussians, up="z")
    import_ply(tmp_path / "scene.ply").location = (5, 6, 7)
    bpy.context.view_layer.update()
    export(tmp_path / "out", scope="SCENE", origin="OBJECT")
    np.testing.assert_allclose(formats.read_ply(tmp_path / "out" / "scene.ply").means, gaussians.means, atol=1e-6)
