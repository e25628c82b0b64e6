"""One selection: the row of the list is the object that is active and selected in Blender; its eye is Blender's eye."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, isolated, write_object


@pytest.fixture
def two(project: Any) -> SimpleNamespace:
    """A project with the objects Vase and Bust, shown apart; Vase is selected."""
    write_object(project.folder, "bust", "Bust", np.r_[np.zeros(60), np.ones(40)].astype(np.float32))
    bpy.ops.heritage.open_project(directory=str(project.folder))
    bpy.context.scene.heritage.show = "OBJECTS"
    found = isolated()
    select(found["vase"])
    return SimpleNamespace(vase=found["vase"], bust=found["bust"], scene=bpy.context.scene)


def select(obj: bpy.types.Object) -> None:
    """Select an object in Blender, as a click in the outliner does."""
    layer = bpy.context.view_layer
    for other in layer.objects:
        other.select_set(other == obj)
    layer.objects.active = obj
    layer.update()


def row() -> bpy.types.Object | None:
    number = bpy.context.scene.heritage.active
    return bpy.data.objects[number] if number >= 0 else None


def selected() -> list[bpy.types.Object]:
    return [obj for obj in bpy.context.view_layer.objects if obj.select_get()]


def test_row_of_the_list_and_blenders_selection_are_the_same_in_both_directions(two: SimpleNamespace) -> None:
    assert row() == two.vase
    two.scene.heritage.active = bpy.data.objects.find("Bust")
    assert bpy.context.view_layer.objects.active == two.bust and selected() == [two.bust]
    select(two.vase)
    assert row() == two.vase
    two.vase.select_set(False)
    assert row() is None
    empty = bpy.data.objects.new("Empty", None)
    two.scene.collection.objects.link(empty)
    select(empty)
    assert row() is None
    two.scene.heritage.active = -1
    assert selected() == [empty]


def test_only_object_in_blenders_box_becomes_the_row(two: SimpleNamespace) -> None:
    # Blender's box, lasso and circle leave the active object as it was.
    two.vase.select_set(False)
    two.bust.select_set(True)
    bpy.context.view_layer.update()
    assert row() == bpy.context.view_layer.objects.active == two.bust
    # A script may make another one active.
    bpy.context.view_layer.objects.active = two.vase
    for _ in range(2):
        two.vase.update_tag()
        bpy.context.view_layer.update()
    assert bpy.context.view_layer.objects.active == two.vase


def test_row_stays_while_the_whole_scene_is_shown_in_place_of_its_objects(two: SimpleNamespace) -> None:
    two.scene.heritage.show = "SCENE"
    bpy.context.view_layer.update()
    assert row() == two.vase and not two.vase.visible_get()
    two.scene.heritage.active = bpy.data.objects.find("Bust")
    assert row() == bpy.context.view_layer.objects.active == two.bust and selected() == []
    two.scene.heritage.show = "OBJECTS"
    assert row() == two.bust and selected() == [two.bust]


def test_row_in_edit_mode_is_where_edits_go_and_blenders_afterwards(two: SimpleNamespace) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    assert row() == two.vase
    two.scene.heritage.active = bpy.data.objects.find("Bust")
    assert row() == two.bust and bpy.context.view_layer.objects.active == two.vase
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert row() == two.vase


def test_object_that_the_view_layer_leaves_out_says_what_to_do(two: SimpleNamespace, part: Part) -> None:
    collection = two.bust.users_collection[0]
    bpy.context.view_layer.layer_collection.children[collection.name].exclude = True
    part("gaussian_heritage_addon.blender.problems").clear()
    two.scene.heritage.active = bpy.data.objects.find("Bust")
    assert "Tick it in the outliner" in part("gaussian_heritage_addon.blender.problems").shown()
    assert row() == two.vase


def test_eye_of_the_outliner_and_of_the_list_are_the_same(two: SimpleNamespace) -> None:
    layer = bpy.context.view_layer
    two.vase.hide_set(True)
    layer.update()
    assert two.vase.heritage.hidden and two.vase.hide_render and not two.bust.heritage.hidden
    two.vase.heritage.hidden = False
    assert two.vase.visible_get() and not two.vase.hide_render
    two.bust.heritage.hidden = True
    assert two.bust.hide_get() and not two.bust.visible_get()
    two.bust.hide_set(False)
    layer.update()
    assert not two.bust.heritage.hidden and not two.bust.hide_render and two.bust.visible_get()


def test_eye_is_kept_in_the_file_and_by_the_choice_between_scene_and_objects(
    two: SimpleNamespace, tmp_path: Any
) -> None:
    two.vase.hide_set(True)
    bpy.context.view_layer.update()
    two.scene.heritage.show = "SCENE"
    two.scene.heritage.show = "OBJECTS"
    assert not two.vase.visible_get() and two.bust.visible_get()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "eye.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "eye.blend"))
    vase = bpy.data.objects["Vase"]
    assert vase.heritage.hidden and vase.hide_get() and not bpy.data.objects["Bust"].hide_get()


# ---- clicks and boxes


def looking_at(obj: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Return a ray through the densest part of an object that is shown."""
    means = np.array([obj.matrix_world @ vertex.co for vertex in obj.data.vertices])
    center = np.median(means, axis=0)
    nearest = means[np.linalg.norm(means - center, axis=1).argmin()]
    origin = nearest + np.array([0.0, -10.0, 0.0])
    return origin, np.array([0.0, 1.0, 0.0])


def opaque(obj: bpy.types.Object, far: float) -> None:
    """Make an object of large opaque Gaussians, `far` along X."""
    base = obj.data.attributes["radiance:base"]
    values = np.zeros((len(obj.data.vertices), 4), np.float32)
    base.data.foreach_get("vector" if base.data_type == "FLOAT4" else "color", values.ravel())
    values[:, 3] = 0.99
    base.data.foreach_set("vector" if base.data_type == "FLOAT4" else "color", values.ravel())
    obj.location.x += far
    obj.data.update_tag()
    bpy.context.view_layer.update()


def test_click_on_visible_splats_meets_the_nearest_object_that_is_shown(two: SimpleNamespace, part: Part) -> None:
    selection = part("gaussian_heritage_addon.splats.view_selection")
    opaque(two.vase, 20.0)
    opaque(two.bust, -20.0)
    both = [two.vase, two.bust]
    for obj in both:
        found, distance = selection.object_seen(both, looking_at(obj))
        assert found == obj and 5 < distance < 15
    assert selection.object_seen(both, (np.array([0.0, -10, 0]), np.array([0.0, 1, 0])))[0] is None
    # One behind the other.
    two.bust.location = two.vase.location
    two.bust.location.y += 5.0
    bpy.context.view_layer.update()
    assert selection.object_seen(both, looking_at(two.vase))[0] == two.vase
    # What the threshold hides cannot be clicked.
    two.vase.heritage.threshold = 1.0
    two.vase.data.attributes["membership"].data.foreach_set("value", np.zeros(len(two.vase.data.vertices), np.float32))
    two.vase.data.update_tag()
    bpy.context.view_layer.update()
    assert selection.object_seen([two.vase], looking_at(two.vase))[0] is None


def test_box_catches_the_objects_with_splats_in_it(two: SimpleNamespace, part: Part) -> None:
    selection, sight = (
        part("gaussian_heritage_addon.splats.view_selection"),
        part("gaussian_heritage_addon.splats.sight"),
    )
    opaque(two.vase, 20.0)
    opaque(two.bust, -20.0)
    view = sight.Sight(1000, 1000, FROM_FRONT)
    both = [two.vase, two.bust]

    def within(left: float, right: float) -> list[bpy.types.Object]:
        corners = np.array([(left, 0), (right, 0), (right, 1000), (left, 1000)], np.float64)
        found: list[bpy.types.Object] = selection.objects_within(both, view, corners)
        return found

    assert within(600, 900) == [two.vase] and within(100, 400) == [two.bust] and within(480, 520) == []
    assert within(0, 1000) == both


@pytest.mark.parametrize(
    ("options", "was_selected", "is_selected"),
    [
        ({}, ["Bust"], ["Vase"]),
        ({"toggle": True}, ["Bust"], ["Bust", "Vase"]),
        ({"toggle": True}, ["Vase"], []),
        ({"extend": True}, ["Bust"], ["Bust", "Vase"]),
        ({"deselect": True}, ["Bust", "Vase"], ["Bust"]),
    ],
)
def test_click_selects_as_blender_does(
    two: SimpleNamespace, part: Part, options: dict[str, bool], was_selected: list[str], is_selected: list[str]
) -> None:
    operator = part("operators.select_splats").HERITAGE_OT_select_splats
    select(bpy.data.objects[was_selected[0]])
    for name in was_selected:
        bpy.data.objects[name].select_set(True)
    given = SimpleNamespace(**({"extend": False, "deselect": False, "toggle": False} | options))
    operator.select(given, bpy.context, two.vase)
    assert sorted(obj.name for obj in selected()) == is_selected
    if "Vase" in is_selected:
        assert row() == bpy.context.view_layer.objects.active == two.vase


def test_splats_are_clicked_in_object_mode_of_a_view_that_draws_them(two: SimpleNamespace, part: Part) -> None:
    selection = part("gaussian_heritage_addon.splats.view_selection")
    area, region = SimpleNamespace(type="VIEW_3D"), SimpleNamespace(type="WINDOW")

    def found(**other: Any) -> list[bpy.types.Object]:
        known = {"area": area, "region": region, "mode": "OBJECT", "scene": two.scene, "space_data": None}
        context = SimpleNamespace(**(known | {"view_layer": bpy.context.view_layer} | other))
        splats: list[bpy.types.Object] = selection.selectable_splats(context)
        return splats

    assert set(found()) == {two.vase, two.bust}
    assert found(mode="EDIT_MESH") == found(area=SimpleNamespace(type="OUTLINER")) == []
    two.bust.hide_select = True
    two.scene.heritage_display.kind = "SPLATS"
    assert found() == [two.vase]
    two.vase.heritage.hidden = True
    assert found() == []
    two.vase.heritage.hidden = False
    two.scene.heritage_display.kind = "SHAPES"
    assert found() == []


FROM_FRONT = np.array([[0.02, 0, 0, 0], [0, 0, 0.02, 0], [0, 0.001, 0, 0], [0, 0, 0, 1.0]])
"""From -Y, 100 units wide: a unit is 10 of 1000 pixels, and the middle is the origin."""


@pytest.fixture
def lines(blender: ModuleType) -> dict[str, bpy.types.Object]:
    """Objects that Blender draws as lines, around (10, 0, 10): pixel (600, 600)."""
    mesh = bpy.data.meshes.new("ruler")
    mesh.from_pydata([(0, 0, 0), (20, 0, 20)], [(0, 1)], [])
    data = {"ruler": mesh, "camera": bpy.data.cameras.new("camera"), "empty": None, "light": None}
    data["light"] = bpy.data.lights.new("light", "POINT")
    made = {name: bpy.data.objects.new(name, one) for name, one in data.items()}
    for name, obj in made.items():
        obj.location = (0, 0, 0) if name == "ruler" else (10, 0, 10)
        bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    return made


def view_context(**other: Any) -> SimpleNamespace:
    """A 3D view, which Blender has none of without a window."""
    view = SimpleNamespace(view_perspective="PERSP")
    known = {"scene": bpy.context.scene, "visible_objects": bpy.context.visible_objects, "region_data": view}
    known |= {"evaluated_depsgraph_get": bpy.context.evaluated_depsgraph_get, "space_data": None}
    return SimpleNamespace(**known | other)


def test_lines_are_near_a_click_where_blender_may_draw_them(lines: dict[str, bpy.types.Object], part: Part) -> None:
    near = part("gaussian_heritage_addon.splats.line_objects").lines_near
    view = part("gaussian_heritage_addon.splats.sight").Sight(1000, 1000, FROM_FRONT)

    def found(*place: float) -> set[str]:
        return {obj.name for obj in near(view_context(), view, place, 6)}

    # What a light draws is not known here: Blender is asked.
    assert found(600, 600) == {"ruler", "camera", "empty", "light"}
    assert found(560, 565) == {"ruler", "light"}
    # Within the box around the ruler, but not on it.
    assert found(550, 650) == {"light"}
    # The cameras of photos are drawn small.
    assert "camera" in found(612, 600)
    lines["camera"].data.display_size = 0.05
    assert "camera" not in found(612, 600) and "camera" in found(603, 600)
    lines["empty"].empty_display_size = 6.0
    bpy.context.view_layer.update()
    assert found(550, 650) == {"empty", "light"}
    lines["empty"].hide_select = True
    assert found(550, 650) == {"light"}


def test_camera_of_the_view_is_its_frame_alone(lines: dict[str, bpy.types.Object], part: Part) -> None:
    near = part("gaussian_heritage_addon.splats.line_objects").lines_near
    camera, scene = lines["camera"], bpy.context.scene
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 40.0, (0, -5, 0)
    camera.rotation_euler = (np.pi / 2, 0, 0)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = 500
    bpy.context.view_layer.update()
    view = part("gaussian_heritage_addon.splats.sight").Sight(1000, 1000, FROM_FRONT)
    through = view_context(region_data=SimpleNamespace(view_perspective="CAMERA"))

    def is_near(*place: float) -> bool:
        return camera in near(through, view, place, 6)

    # The frame is 40 units wide, 400 pixels.
    assert [is_near(300 + off, 500) for off in (-10, 0, 10)] == [False, True, False]
    assert is_near(700, 420) and not is_near(500, 500)
    camera.data.show_composition_center = True
    assert is_near(500, 500)


def test_click_on_splats_far_from_all_lines_does_not_ask_blender_what_it_draws(
    lines: dict[str, bpy.types.Object], part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first such question of a session compiles shaders: half a second of a click."""
    selection = part("gaussian_heritage_addon.splats.view_selection")
    view = part("gaussian_heritage_addon.splats.sight").Sight(1000, 1000, FROM_FRONT)
    bpy.data.objects.remove(lines["light"])
    asked: list[list[str]] = []

    def has_line(context: Any, place: tuple[int, int], found: list[bpy.types.Object]) -> bool:
        asked.append(sorted(obj.name for obj in found))
        return True

    monkeypatch.setattr(selection, "_has_line", has_line)
    assert not selection.hides_splats(view_context(), view, (550, 650), 100.0) and asked == []
    assert selection.hides_splats(view_context(), view, (560, 560), 100.0) and asked == [["ruler"]]
    # Another object of Blender in front of the splats, but not behind them.
    bpy.ops.mesh.primitive_cube_add(location=(5, 0, 15))
    assert selection.hides_splats(view_context(), view, (550, 650), 10_000.0) and asked == [["ruler"]]
    assert not selection.hides_splats(view_context(), view, (550, 650), 1.0)


# ---- Edit Mode


def test_edit_mode_shows_the_splats_of_the_object_alone(two: SimpleNamespace, part: Part) -> None:
    edited = part("gaussian_heritage_addon.splats.edited_splats")
    two.vase.heritage.threshold = 0.6
    assert not two.vase.modifiers["Gaussian Splats"].show_in_editmode
    select(two.vase)
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        assert edited.edited_splats(two.vase) is None
        edited._read_changed()
        read = edited.edited_splats(two.vase)
        assert len(read.attribute("position")) == len(two.vase.data.vertices) and read.version == 0
        _, hidden = edited.vertex_flags(two.vase)
        np.testing.assert_array_equal(~hidden, read.membership >= np.float32(0.6))
        assert 0 < hidden.sum() < len(hidden)
        bpy.ops.mesh.select_all(action="SELECT")
        picked, _ = edited.vertex_flags(two.vase)
        np.testing.assert_array_equal(picked, ~hidden)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_moved_vertices_are_drawn_where_they_are_in_edit_mode(two: SimpleNamespace, part: Part) -> None:
    edited = part("gaussian_heritage_addon.splats.edited_splats")
    select(two.vase)
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        edited._read_changed()
        before = edited.edited_splats(two.vase).attribute("position").copy()
        mesh = edited.bmesh.from_edit_mesh(two.vase.data)
        for vertex in mesh.verts:
            vertex.co.x += 1.0
        edited.bmesh.update_edit_mesh(two.vase.data)
        edited._changed_at[two.vase.data.name_full] = -edited._PAUSE
        edited._read_changed()
        after = edited.edited_splats(two.vase)
        np.testing.assert_allclose(after.attribute("position")[:, 0], before[:, 0] + 1.0, atol=1e-6)
        assert after.version == 1
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_selected_gaussians_are_marked_in_the_list_that_is_drawn(two: SimpleNamespace, part: Part) -> None:
    view = part("gaussian_heritage_addon.splats.splat_view")
    count = len(two.vase.data.vertices)
    tables = SimpleNamespace(
        parts=[part("gaussian_heritage_addon.splats.splat_tables").Part.of(splats_of(part, two.vase))]
    )
    tables.starts = [0, count]
    far = bpy.data.objects.new("eye", None).matrix_world.copy()
    far.translation = (0.0, 0.0, -20.0)
    flags = np.zeros(count, bool), np.zeros(count, bool)
    flags[0][:5], flags[1][10:20] = True, True
    lens = view.View((1.0, 1.0), (0.0, 0.0), True)
    two.vase.heritage.threshold = 0.0
    order = view._order(tables, [two.vase], [far], lens, 1.0, {"Vase": flags})
    assert set(-1 - order[order < 0]) == set(range(5))
    assert set(order[order >= 0]) == set(range(5, 10)) | set(range(20, count))


def splats_of(part: Part, obj: bpy.types.Object) -> Any:
    return part("gaussian_heritage_addon.splats.splats").SplatScene.of(obj)
