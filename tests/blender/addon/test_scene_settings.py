"""Render settings belong to the user, and an object without its own scene stays visible."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import pytest
from conftest import Part


def settings() -> tuple[Any, ...]:
    scene = bpy.context.scene
    cycles = scene.cycles
    return (
        scene.render.engine,
        scene.view_settings.view_transform,
        cycles.samples,
        cycles.use_denoising,
        cycles.transparent_max_bounces,
        round(cycles.filter_width, 4),
    )


@pytest.fixture
def ply(part: Part, random_gaussians: Callable[..., Any], tmp_path: Path) -> Path:
    part("engine.formats").write_ply(tmp_path / "scene.ply", random_gaussians(20))
    return tmp_path / "scene.ply"


@pytest.mark.parametrize("use_cycles", [True, False])
def test_import_beside_own_work_keeps_the_settings_until_the_button_is_pressed(ply: Path, use_cycles: bool) -> None:
    bpy.ops.mesh.primitive_monkey_add()
    before = settings()
    bpy.ops.heritage.import_gaussian_ply(filepath=str(ply), use_cycles=use_cycles)
    bpy.context.scene.heritage.blending = "TRAINED"
    assert settings() == before
    bpy.ops.heritage.set_up_render()
    assert settings()[:5] == ("CYCLES", "Raw", 1, False, 256)


def test_settings_that_the_user_changed_in_an_empty_scene_stay(ply: Path) -> None:
    bpy.context.scene.cycles.samples = 77
    before = settings()
    bpy.ops.heritage.import_gaussian_ply(filepath=str(ply))
    assert settings() == before


def test_settings_of_a_new_file_come_back_when_the_splats_are_gone(part: Part, ply: Path) -> None:
    before, scene = settings(), bpy.context.scene
    bpy.ops.heritage.import_gaussian_ply(filepath=str(ply))
    assert settings()[:3] == ("CYCLES", "Standard", 1)
    code = part("gaussian_heritage_addon.splats.render_settings")
    assert not code.missing_settings(scene)
    assert not code.can_restore(scene)
    bpy.data.objects.remove(next(obj for obj in scene.objects if obj.heritage.role == "SCENE"))
    assert code.can_restore(scene)
    bpy.ops.heritage.restore_render()
    assert settings() == before


def test_new_scene_with_splats_says_what_its_render_needs(part: Part, ply: Path) -> None:
    bpy.ops.heritage.import_gaussian_ply(filepath=str(ply))
    obj = next(obj for obj in bpy.context.scene.objects if obj.heritage.role == "SCENE")
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(obj)
    other.render.engine, other.view_settings.view_transform = "CYCLES", "AgX"
    code = part("gaussian_heritage_addon.splats.render_settings")
    assert code.missing_settings(other) == ["transparent_bounces", "samples", "view_transform"]
    code.set_up_render(other)
    assert not code.missing_settings(other)


def test_object_without_its_own_scene_stays_visible(ply: Path) -> None:
    bpy.ops.heritage.import_gaussian_ply(filepath=str(ply))
    scene = bpy.context.scene
    whole = next(obj for obj in scene.objects if obj.heritage.role == "SCENE")
    copy = whole.copy()
    scene.collection.objects.link(copy)
    copy.heritage.role, copy.heritage.project = "OBJECT", str(ply.parent / "elsewhere")
    scene.heritage.show = "SCENE"
    assert not copy.hide_render
    assert not whole.hide_render
    scene.heritage.show = "OBJECTS"
    assert not whole.hide_render
    whole.heritage.project = copy.heritage.project
    scene.heritage.show = "SCENE"
    assert copy.hide_render
    assert not whole.hide_render
    scene.heritage.show = "OBJECTS"
    assert whole.hide_render
    assert not copy.hide_render
