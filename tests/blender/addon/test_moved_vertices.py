"""Splats follow operators of Blender that move vertices without their attributes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part


@pytest.fixture
def splats(part: Part, random_gaussians: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that adds an object of random Gaussians and selects it."""

    def make(count: int = 60, seed: int = 0) -> Any:
        scene = part("gaussian_heritage_addon.splats.splats").SplatScene
        made = scene.create("splats", random_gaussians(count, seed=seed), bpy.context.scene.collection)
        made.object.select_set(True)
        bpy.context.view_layer.objects.active = made.object
        return made

    return make


def numbers(gaussians: Any) -> dict[str, np.ndarray]:
    w, x, y, z = (gaussians.quats / np.linalg.norm(gaussians.quats, axis=1, keepdims=True)).T.astype(float)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    axes = turn * np.exp(gaussians.log_scales.astype(float))[:, None, :]
    return {"means": gaussians.means, "covariances": axes @ axes.transpose(0, 2, 1), "sh": gaussians.sh}


def assert_same(got: Any, wanted: Any) -> None:
    wanted_numbers = numbers(wanted)
    for name, values in numbers(got).items():
        np.testing.assert_allclose(values, wanted_numbers[name], atol=2e-4 * np.abs(wanted_numbers[name]).max())


def place(obj: bpy.types.Object, scale: float = 2.0) -> None:
    obj.location, obj.rotation_euler, obj.scale = (1, -2, 0.5), (0.3, -0.7, 1.9), (scale, scale, scale)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("scale", [(2, 2, 2), (2, 0.5, 1), (-1, 1, 1)])
def test_applied_transforms_change_sizes_rotations_and_colours(splats: Any, scale: tuple[float, ...]) -> None:
    made = splats()
    place(made.object)
    made.object.scale = scale
    bpy.context.view_layer.update()
    wanted = made.gaussians()
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    bpy.context.view_layer.update()
    assert_same(made.gaussians(), wanted)
    # What the viewport draws are the attributes.
    volumes = made.attribute("scale").prod(axis=1)
    np.testing.assert_allclose(volumes, np.exp(wanted.log_scales.sum(axis=1)), rtol=1e-3)


def test_objects_joined_keep_their_sizes(splats: Any) -> None:
    first, second = splats(seed=1), splats(count=90, seed=2)
    place(second.object, 3.0)
    second.object.select_set(True)
    first.object.select_set(True)
    bpy.context.view_layer.objects.active = first.object
    wanted = first.gaussians().joined(second.gaussians())
    bpy.ops.object.join()
    assert_same(first.gaussians(), wanted)


def test_a_copy_joined_with_its_original_keeps_its_size(splats: Any) -> None:
    first = splats()
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    place(copy, 3.0)
    wanted = first.gaussians().joined(type(first).of(copy).gaussians())
    first.object.select_set(True)
    bpy.context.view_layer.objects.active = first.object
    bpy.ops.object.join()
    assert_same(first.gaussians(), wanted)


def test_vertices_moved_by_hand_keep_their_sizes(splats: Any) -> None:
    made = splats()
    before = made.local_gaussians()
    made.object.data.vertices[3].co.x += 1
    made.object.data.vertices[7].co.y -= 2
    made.object.data.update()
    after = made.local_gaussians()
    np.testing.assert_array_equal(after.log_scales, before.log_scales)
    np.testing.assert_array_equal(after.quats, before.quats)


def test_a_vertex_moved_by_hand_follows_what_is_applied(splats: Any) -> None:
    made = splats()
    made.object.data.vertices[3].co.x += 1
    place(made.object, 2.0)
    wanted = made.gaussians()
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    assert_same(made.gaussians(), wanted)


def test_applied_sizes_survive_saving(splats: Any, tmp_path: Path) -> None:
    made = splats()
    place(made.object)
    wanted = made.gaussians()
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert_same(made.gaussians(), wanted)
