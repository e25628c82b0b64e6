"""Splats in other scenes, in files that they were appended to, and in a Blender without the add-on."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, isolated
from test_render import rendered_by_cycles, rendered_by_formula, show

_IN_PLAIN_BLENDER = """
import sys
import bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types.Scene, "heritage")
seen = bpy.context.evaluated_depsgraph_get()
shapes = [one for one in seen.object_instances if one.is_instance]
dots = [obj for obj in bpy.context.scene.objects if obj.type == "MESH" and not obj.modifiers[0].show_viewport]
print("SEEN", len(shapes), len(dots), flush=True)
"""


def seen_without_the_addon(file: Path, tmp_path: Path) -> list[int]:
    """How many shapes, and objects that are drawn as dots, another Blender without the add-on shows of a .blend."""
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "nobody")}
    (tmp_path / "nobody").mkdir(exist_ok=True)
    command = [sys.executable, "-P", "-c", _IN_PLAIN_BLENDER, str(file)]
    # On Windows, Blender prints the names of files in another code page than Python reads.
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=True)
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("SEEN")]
    return [int(word) for word in line.split()[1:]]


def test_saved_splats_are_seen_in_a_blender_without_the_addon(
    part: Part, random_gaussians: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, nodes = bpy.context.scene, part("gaussian_heritage_addon.splats.splat_nodes")
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.create(
        "s", random_gaussians(30), scene.collection
    )
    splats.object.heritage.role = "SCENE"
    settings = part("gaussian_heritage_addon.splats.display_settings")
    settings.apply_displays()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "small.blend"))
    assert nodes.display_input(splats.object, nodes.SHAPES) is False
    shapes, dots = seen_without_the_addon(tmp_path / "small.blend", tmp_path)
    assert shapes > 20 and not dots
    monkeypatch.setattr(settings, "_MOST_ON_PROCESSOR", 29)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "large.blend"))
    assert splats.object.modifiers[0].show_viewport
    assert seen_without_the_addon(tmp_path / "large.blend", tmp_path) == [0, 1]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "large.blend"))
    (obj,) = [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]
    assert obj.modifiers[0].show_viewport and nodes.display_input(obj, nodes.SHAPES) is False


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(((one - other) ** 2).mean()))


@pytest.mark.parametrize("link", [False, True], ids=["appended", "linked"])
def test_splats_of_another_file_are_rendered_as_in_it_once_the_scene_is_set_up(
    part: Part, random_gaussians: Callable[..., Any], camera: Any, tmp_path: Path, link: bool
) -> None:
    gaussians = random_gaussians(60, degree=1)
    square = part("engine.scene.camera").Camera("p", 96, 72, "PINHOLE", (130.0, 130.0, 50.0, 34.0), camera.viewmat)
    show(part, gaussians, square)
    bpy.context.scene.heritage.blending = "TRAINED"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "from.blend"))
    expected = rendered_by_formula(part, gaussians, square, linear=False)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    scene = bpy.context.scene
    (bpy.ops.wm.link if link else bpy.ops.wm.append)(directory=f"{tmp_path / 'from.blend'}/Object/", filename="s")
    part("gaussian_heritage_addon.project.cameras").add_cameras([square], scene.collection)
    render = part("gaussian_heritage_addon.splats.render_settings")
    assert render.missing_settings(scene)[-1] == "view_transform"
    bpy.ops.heritage.set_up_render()
    assert not render.missing_settings(scene)
    bpy.ops.heritage.look_through_photo()
    # The goal of renders of splats.
    assert psnr(rendered_by_cycles(tmp_path), expected) >= 28


def test_collection_that_was_hidden_in_its_own_file_is_shown_where_it_is_appended(
    opened: Any, part: Part, tmp_path: Path
) -> None:
    bpy.context.scene.heritage.show = "SCENE"
    vase = isolated()["vase"]
    assert vase.hide_viewport and vase.hide_render
    name = vase.users_collection[0].name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "from.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    bpy.ops.wm.append(directory=f"{tmp_path / 'from.blend'}/Collection/", filename=name)
    vase = isolated()["vase"]
    assert not vase.hide_viewport and not vase.hide_render


def test_splats_that_are_appended_to_others_blend_as_these(
    part: Part, random_gaussians: Callable[..., Any], tmp_path: Path
) -> None:
    create, nodes = (
        part("gaussian_heritage_addon.splats.splats").SplatScene.create,
        part("gaussian_heritage_addon.splats.splat_nodes"),
    )
    create("s", random_gaussians(5), bpy.context.scene.collection).object.heritage.role = "SCENE"
    bpy.context.scene.heritage.blending = "TRAINED"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "from.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    create("own", random_gaussians(5), bpy.context.scene.collection).object.heritage.role = "SCENE"
    bpy.ops.wm.append(directory=f"{tmp_path / 'from.blend'}/Object/", filename="s")
    assert bpy.context.scene.heritage.blending == "LINEAR"
    assert nodes.display_input(bpy.data.objects["s"], nodes.AS_TRAINED) is False
