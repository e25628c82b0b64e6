"""What the viewports show of splats: bounds, new and hidden objects, displays of earlier files, Blender's own type."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, StandIn, isolated, write_object
from mathutils import Matrix

Draw = Callable[[str], Any]


def bounds(obj: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    corners = np.array([corner[:] for corner in obj.bound_box])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def test_a_slider_that_is_reset_is_where_the_engine_starts_it(opened: Any, part: Part) -> None:
    vase = isolated()["vase"]
    vase.heritage.threshold = 0.9
    vase.heritage.property_unset("threshold")
    assert vase.heritage.threshold == part("engine.objects.settings").DEFAULT_THRESHOLD > 0


def test_bounds_are_those_of_the_gaussians_that_are_shown(opened: Any, part: Part) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    vase = isolated()["vase"]
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.of(vase)
    means, opacities = splats.attribute("position"), splats.attribute("radiance:base")[:, 3]
    opaque = opacities > part("gaussian_heritage_addon.splats.splat_nodes")._SOLID_OPACITY
    for threshold in (0.5, 0.9):
        vase.heritage.threshold = threshold
        shown = means[opaque & (splats.membership >= np.float32(threshold))]
        np.testing.assert_allclose(bounds(vase), [shown.min(axis=0), shown.max(axis=0)], atol=1e-5)
    low, high = part("gaussian_heritage_addon.splats.splat_boxes").shown_box(vase)
    members = means[splats.membership >= np.float32(0.9)]
    assert (low >= members.min(axis=0) - 1e-6).all() and (high <= members.max(axis=0) + 1e-6).all()


def test_threshold_is_dragged_without_reading_the_gaussians_again_and_edits_are_seen(
    opened: Any, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    view, built = part("gaussian_heritage_addon.splats.splat_view"), []
    # Textures need a window.
    monkeypatch.setattr(view, "Tables", lambda objects, parts: built.append(parts) or object())
    view._forget_all()
    bpy.context.scene.heritage.show = "OBJECTS"
    vase = isolated()["vase"]
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.of(vase)

    def drawn_after(change: Callable[[], None]) -> int:
        change()
        # Blender names the mesh after both kinds of change.
        view._forget([vase.data])
        view.tables_of([vase])
        return len(built)

    assert drawn_after(lambda: None) == 1
    assert drawn_after(lambda: setattr(vase.heritage, "threshold", 0.8)) == 1
    assert drawn_after(lambda: splats.set_membership(splats.membership * 0.5)) == 2
    assert drawn_after(lambda: vase.data.transform(Matrix.Translation((1, 0, 0)))) == 3
    np.testing.assert_allclose(built[-1][0].means, splats.attribute("position"))
    view._forget_all()


def test_nothing_is_outlined_but_in_the_display_of_shapes(opened: Any) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")

    def instances() -> int:
        found = bpy.context.evaluated_depsgraph_get().object_instances
        return sum(1 for one in found if one.parent and one.parent.original == whole)

    bpy.context.scene.heritage_display.kind = "POINTS"
    # The points without a size that carry the bounds.
    assert instances() <= 1
    bpy.context.scene.heritage_display.kind = "SHAPES"
    assert instances() > 50


FOUND = """
project = Path(sys.argv[4])
rest = np.ones(100, np.float32)
for row, name in ((50, "nail"), (70, "envelope")):
    members = np.zeros(100, np.float32)
    members[row:row + 9] = 1
    rest -= members
    write_object(project, name, name, members, prompt={"kind": "all"})
write_object(project, "background", "background", rest, prompt={"kind": "background"})
say("finished", outputs={"objects": ["envelope", "nail", "background"], "kept": []})
"""


def test_find_all_selects_what_it_found_and_hides_the_background(opened: Any, fake_engine: StandIn, draw: Draw) -> None:
    fake_engine(FOUND)
    assert bpy.ops.heritage.find_objects() == {"FINISHED"}
    found = isolated()
    assert {name for name, obj in found.items() if obj.heritage.hidden} == {"background"}
    assert found["background"].hide_get() and found["background"].hide_render
    assert {obj.heritage.object_id for obj in bpy.context.selected_objects} == {"envelope", "nail"}
    assert bpy.context.view_layer.objects.active == found["envelope"]
    assert any("guess" in text for text in draw("HERITAGE_PT_objects").texts)


def test_background_that_was_asked_for_is_shown(opened: Any, fake_engine: StandIn) -> None:
    fake_engine(FOUND.replace('["envelope", "nail", "background"]', '["background"]'))
    bpy.ops.heritage.isolate_background()
    assert isolated()["background"].visible_get()


def test_background_of_a_project_that_is_opened_is_hidden_until_the_user_shows_it(project: Any) -> None:
    write_object(project.folder, "rest", "rest", np.ones(100, np.float32), prompt={"kind": "background"})
    bpy.ops.heritage.open_project(directory=str(project.folder))
    assert {name for name, obj in isolated().items() if obj.heritage.hidden} == {"rest"}
    isolated()["rest"].heritage.hidden = False
    bpy.ops.heritage.open_project(directory=str(project.folder))
    assert not isolated()["rest"].heritage.hidden


def test_solo_hides_the_others_and_again_shows_them(opened: Any, fake_engine: StandIn) -> None:
    fake_engine(FOUND)
    bpy.ops.heritage.find_objects()
    scene, found = bpy.context.scene, isolated()
    scene.heritage.active = bpy.data.objects.find(found["nail"].name)
    assert bpy.ops.heritage.solo_object() == {"FINISHED"}
    assert {name for name, obj in found.items() if obj.visible_get()} == {"nail"}
    bpy.ops.heritage.solo_object()
    assert {name for name, obj in found.items() if not obj.visible_get()} == {"background"}
    found["vase"].heritage.hidden = True
    assert found["vase"].hide_get() and found["vase"].hide_render
    scene.heritage.show = "SCENE"
    scene.heritage.show = "OBJECTS"
    assert not found["vase"].visible_get() and found["nail"].visible_get()
    scene.heritage.active = -1
    with pytest.raises(RuntimeError, match="Select an isolated object in the list first"):
        bpy.ops.heritage.solo_object()


def test_large_scenes_are_shown_in_part_at_first(opened: Any, part: Part) -> None:
    settings = part("gaussian_heritage_addon.splats.display_settings")
    scene = bpy.context.scene
    for count, software, all_shown in ((40_000, True, True), (1_500_000, False, True), (1_500_000, True, False)):
        settings.choose_display(scene, count, software=software)
        assert (scene.heritage_display.share == 1.0) == all_shown
    assert 0.1 < scene.heritage_display.share < 0.5


def test_splats_that_cannot_be_drawn_are_left_to_blender(opened: Any, part: Part) -> None:
    nodes = part("gaussian_heritage_addon.splats.splat_nodes")
    part("gaussian_heritage_addon.splats.splat_view")._show_shapes()
    assert bpy.context.scene.heritage_display.kind == "SHAPES"
    assert all(nodes.display_input(obj, nodes.SHAPES) for obj in isolated().values())


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="Blender 5.2 and newer have the attributes")
def test_point_cloud_has_the_attributes_of_blenders_own_import(part: Part, random_gaussians: Any) -> None:
    native, gaussians = part("gaussian_heritage_addon.splats.native_splats"), random_gaussians(30)
    cloud = native.new_point_cloud("cloud", gaussians)
    values = np.zeros(30 * 4, np.float32)
    cloud.attributes["radiance:base"].data.foreach_get("vector", values)
    np.testing.assert_allclose(values.reshape(30, 4)[:, 3], gaussians.opacities, rtol=1e-6)
    coefficient = np.zeros(30 * 3, np.float32)
    cloud.attributes["radiance:sh_14"].data.foreach_get("vector", coefficient)
    np.testing.assert_array_equal(coefficient.reshape(30, 3), gaussians.sh[:, 15])
    kinds = {name: cloud.attributes[name].data_type for name in ("position", "rotation", "scale", "radiance:base")}
    assert list(kinds.values()) == ["FLOAT_VECTOR", "QUATERNION", "FLOAT_VECTOR", "FLOAT4"]


@pytest.mark.skipif(bpy.app.version >= (5, 3, 0), reason="Blender 5.3 has the type")
def test_older_blender_says_that_it_has_no_type_for_gaussians(opened: Any, part: Part) -> None:
    assert not part("gaussian_heritage_addon.splats.native_splats").is_native()
    with pytest.raises(RuntimeError, match=r"Use Blender 5\.3"):
        bpy.ops.heritage.copy_as_native()
