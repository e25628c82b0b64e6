"""Blender 5.3's own Gaussians: copied from ours, exported by us, and our files in Blender's own readers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part

pytestmark = pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="Blender 5.3 and newer have the type")


@pytest.fixture
def copied(part: Part, random_gaussians: Callable[..., Any]) -> tuple[Any, bpy.types.Object]:
    """Return the Gaussians of an object, and its copy as Blender's own type, selected."""
    gaussians, scene = random_gaussians(30), bpy.context.scene
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.create("s", gaussians, scene.collection)
    splats.object.heritage.role, splats.object.heritage.title = "SCENE", "Teapot"
    assert bpy.ops.heritage.copy_as_native() == {"FINISHED"}
    (cloud,) = [obj for obj in scene.objects if obj.type == "POINTCLOUD"]
    for obj in scene.objects:
        obj.select_set(obj == cloud)
    return gaussians, cloud


def exported(part: Part, folder: Path, suffix: str) -> Any:
    bpy.ops.heritage.export_splats(filepath=str(folder / f"out{suffix}"))
    formats = part("engine.formats")
    return formats.read_ply_file(folder / f"out{suffix}").gaussians


def test_a_native_copy_is_exported_as_its_object(part: Part, copied: Any, tmp_path: Path) -> None:
    gaussians, cloud = copied
    assert cloud.data.type == "GAUSSIAN_SPLAT" and cloud.heritage.title == "Teapot"
    bpy.ops.heritage.export_splats(filepath=str(tmp_path / "copy.ply"))
    for obj in bpy.context.scene.objects:
        obj.select_set(obj.type == "MESH")
    bpy.ops.heritage.export_splats(filepath=str(tmp_path / "object.ply"))
    ours, other = (part("engine.formats").read_ply_file(tmp_path / f"{name}.ply") for name in ("object", "copy"))
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        # The opacity is rounded twice on its way.
        np.testing.assert_allclose(getattr(other.gaussians, name), getattr(ours.gaussians, name), atol=1e-4)


def test_what_was_edited_in_a_native_cloud_is_exported(part: Part, copied: Any, tmp_path: Path) -> None:
    _, cloud = copied
    before = exported(part, tmp_path, ".ply")
    values = np.zeros(30 * 3, np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", values)
    cloud.data.attributes["position"].data.foreach_set("vector", values + 1)
    cloud.scale = (2, 2, 2)
    bpy.context.view_layer.update()
    after = exported(part, tmp_path, ".ply")
    # The file has -Y up, so that one unit more of x, y and z in Blender is (1, -1, 1) in it.
    np.testing.assert_allclose(after.means, 2 * (before.means + (1, -1, 1)), atol=1e-4)
    np.testing.assert_allclose(after.log_scales, before.log_scales + np.log(2), atol=1e-4)


def test_a_cloud_that_lost_its_colours_is_said(part: Part, copied: Any, tmp_path: Path) -> None:
    _, cloud = copied
    cloud.data.attributes.remove(cloud.data.attributes["radiance:sh_14"])
    with pytest.raises(RuntimeError, match="lacks some of its colours"):
        bpy.ops.heritage.export_splats(filepath=str(tmp_path / "out.ply"))


@pytest.mark.parametrize(
    ("suffix", "options"),
    [(".glb", None), (".spz", {}), (".ply", {"forward_axis": "Z", "up_axis": "NEGATIVE_Y"})],
)
def test_blenders_own_readers_show_our_files_upright(
    part: Part, copied: Any, tmp_path: Path, suffix: str, options: dict[str, Any] | None
) -> None:
    gaussians, _ = copied
    file = tmp_path / f"out{suffix}"
    bpy.ops.heritage.export_splats(filepath=str(file))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    if options is None:
        bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
        bpy.ops.import_scene.gltf(filepath=str(file))
    elif suffix == ".spz":
        bpy.ops.wm.spz_import(filepath=str(file))
    else:
        bpy.ops.wm.ply_import(filepath=str(file), **options)
    (cloud,) = [obj for obj in bpy.context.scene.objects if obj.type == "POINTCLOUD"]
    bpy.context.view_layer.update()
    read = part("gaussian_heritage_addon.splats.native_splats").native_gaussians(cloud)
    placed = part("engine.formats").transform_gaussians(read, np.array(cloud.matrix_world, np.float64))
    # SPZ stores positions in steps of 1/4096.
    np.testing.assert_allclose(np.sort(placed.means, axis=0), np.sort(gaussians.means, axis=0), atol=1e-3)
