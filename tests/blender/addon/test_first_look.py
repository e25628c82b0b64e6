"""What a curator meets first: the scene and not Blender's cube, a menu for F3, switches with names, texts that fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import blf
import bpy
import numpy as np
import pytest
from conftest import Draw, FakeLayout, Part, german_texts, isolated


@pytest.fixture
def new_file(blender: ModuleType) -> ModuleType:
    """Blender's own new file, with its cube, light and camera."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=False)
    return blender


def test_untouched_cube_does_not_hide_the_first_look(new_file: ModuleType, project: Any, part: Part) -> None:
    defaults = part("gaussian_heritage_addon.blender.default_objects").untouched_defaults
    cube, light = bpy.data.objects["Cube"], bpy.data.objects["Light"]
    assert not cube.hide_get() and bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    for obj in (cube, light):
        assert obj.hide_get() and obj.hide_render
    assert set(defaults(bpy.context.scene)) == {cube, light}
    # What the user shows again stays shown.
    cube.hide_set(False)
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    assert not cube.hide_get()


def test_cube_that_was_changed_stays_in_view(new_file: ModuleType, project: Any) -> None:
    cube = bpy.data.objects["Cube"]
    cube.location.x = 3.0
    bpy.context.view_layer.update()
    bpy.ops.heritage.open_project(directory=str(project.folder))
    assert not cube.hide_get() and not cube.hide_render


def test_imported_file_is_selected_and_named_after_it(
    blender: ModuleType, part: Part, random_gaussians: Callable[..., Any], tmp_path: Path
) -> None:
    for name in ("Kanne blau", "Vase rot"):
        part("engine.formats").write_ply(tmp_path / f"{name}.ply", random_gaussians(50, degree=0))
        assert bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / f"{name}.ply")) == {"FINISHED"}
        assert bpy.context.view_layer.objects.active.name == name
        assert [obj.name for obj in bpy.context.selected_objects] == [name]


def test_imported_file_is_framed_in_a_window(
    blender: ModuleType, part: Part, random_gaussians: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.create(
        "Vase", random_gaussians(50, degree=0), bpy.context.scene.collection
    )
    module, view = part("gaussian_heritage_addon.project.new_objects"), SimpleNamespace(view_perspective="PERSP")
    area = SimpleNamespace(spaces=SimpleNamespace(active=SimpleNamespace(region_3d=view)))
    app = SimpleNamespace(background=False)
    fake = SimpleNamespace(app=app, types=bpy.types, context=bpy.context)
    monkeypatch.setattr(module, "bpy", fake)
    monkeypatch.setattr(module, "viewports", lambda scene: [area])
    splats.object.location = (5.0, 0.0, 0.0)
    module.show_imported(bpy.context.scene, splats.object)
    assert abs(view.view_location[0] - 5.0) < 1.5 and view.view_distance > 0


def test_menu_has_what_f3_searches_for(opened: Any, part: Part) -> None:
    drawn = FakeLayout()
    menu = part("operators.menus").HERITAGE_MT_objects
    menu.draw(SimpleNamespace(layout=drawn), bpy.context)
    names = [name for name, _ in drawn.buttons]
    assert {"heritage.isolate", "heritage.find_objects", "heritage.click_object", "heritage.add_detail"} <= set(names)
    entry = FakeLayout()
    part("operators.menus").object_menu(SimpleNamespace(layout=entry), bpy.context)
    assert "menu" in entry.calls and hasattr(bpy.types, menu.bl_idname)


def test_isolate_from_a_menu_asks_for_the_words(opened: Any, part: Part) -> None:
    operator = part("operators.isolate").HERITAGE_OT_isolate
    functions = {name: value for name, value in vars(operator).items() if isinstance(value, FunctionType)}
    asked: list[Any] = []
    fake = type("Fake", (), {**functions, "prompt": "", "photo": "", "clicks": ()})()
    manager = SimpleNamespace(invoke_props_dialog=lambda operator, **_: asked.append(operator) or {"RUNNING_MODAL"})
    bpy.context.scene.heritage.prompt = "vase"
    context = SimpleNamespace(scene=bpy.context.scene, window_manager=manager)
    assert fake.invoke(context, None) == {"RUNNING_MODAL"}
    assert asked == [fake] and fake.prompt == "vase"


def test_node_groups_of_splats_are_not_offered_for_other_objects(opened: Any, part: Part) -> None:
    nodes = part("gaussian_heritage_addon.splats.splat_nodes")
    assert bpy.data.node_groups and all(group.name.startswith(".") for group in bpy.data.node_groups)
    count = len(bpy.data.node_groups)
    group = bpy.data.node_groups[0]
    assert nodes._display_group(int(group.name.rpartition(" ")[2])) == group
    assert len(bpy.data.node_groups) == count


def test_switches_have_names(opened: Any, draw: Draw) -> None:
    texts = draw("HERITAGE_PT_scene").texts
    assert {"Show", "Blending"} <= set(texts)


def test_same_bar_does_not_stand_twice(opened: Any, part: Part, draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = part("engine.workers.jobs")
    job = SimpleNamespace(kind="segment", subject=str(opened.folder), of_earlier_session=False)
    state = jobs.JobState(stage="objects", fraction=0.5, message="Looking")
    monkeypatch.setattr(part("gaussian_heritage_addon.jobs.job_runner"), "current", lambda: (job, state))
    drawn = [draw(name) for name in ("HERITAGE_PT_scene", "HERITAGE_PT_progress")]
    assert sum(panel.calls.count("progress") for panel in drawn) == 1
    assert "Looking" in drawn[1].texts


def test_text_in_a_box_is_broken_at_the_width_of_the_box(
    blender: ModuleType, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn_text = part("gaussian_heritage_addon.blender.drawn_text")
    preferences = SimpleNamespace(
        system=SimpleNamespace(ui_scale=2.0), ui_styles=[SimpleNamespace(widget=SimpleNamespace(points=11))]
    )
    context = SimpleNamespace(region=SimpleNamespace(width=2 * 240), preferences=preferences)
    monkeypatch.setattr(drawn_text, "bpy", SimpleNamespace(context=context, app=bpy.app, types=bpy.types))
    text = "The Gaussians of this object were changed in another program; open the project again. " * 3
    for n_boxes, icon in ((0, "NONE"), (1, "NONE"), (1, "ERROR"), (2, "ERROR")):
        drawn = FakeLayout()
        drawn_text.draw_text(drawn, text, icon=icon, n_boxes=n_boxes)
        # In Blender 5.2's window, a panel leaves this much of its region to the letters of a label.
        space = 2 * (240 - 66 - 16 * n_boxes - (20 if icon == "ERROR" else 0))
        widths = [drawn_text._width_of(line) for line in drawn.texts]
        assert max(widths) <= space and np.mean(widths[:-1]) > 0.6 * space


class RowsLayout(FakeLayout):
    """Fake layout that also records the labels of buttons that share a row, and whether each has an icon."""

    def __init__(self, rows: list[list[tuple[str, bool]]], own: list[tuple[str, bool]]) -> None:
        super().__init__()
        self._rows, self._own = rows, own

    def row(self, **options: Any) -> FakeLayout:
        self._rows.append([])
        return RowsLayout(self._rows, self._rows[-1])

    def column(self, **options: Any) -> FakeLayout:
        return RowsLayout(self._rows, [])

    def operator(self, name: str, **options: Any) -> Any:
        own = getattr(bpy.ops.heritage, name.partition(".")[2]).get_rna_type().name
        self._own.append((options.get("text", own), "icon" in options))
        return self._operator(name)


@pytest.mark.parametrize("language", ["English", "German"])
@pytest.mark.parametrize("panel", ["objects", "by_hand", "measure"])
def test_labels_of_two_buttons_in_a_row_fit_the_sidebar(opened: Any, part: Part, panel: str, language: str) -> None:
    german = german_texts(part)
    bpy.context.scene.heritage.active = next(n for n, obj in enumerate(bpy.data.objects) if obj in isolated().values())
    rows: list[list[tuple[str, bool]]] = []
    layout = RowsLayout(rows, [])
    getattr(bpy.types, f"HERITAGE_PT_{panel}").draw(SimpleNamespace(layout=layout), bpy.context)
    pairs = [row for row in rows if len(row) == 2 and all(text for text, _ in row)]
    assert pairs
    blf.size(0, 11)
    for text, has_icon in (button for pair in pairs for button in pair):
        shown = german[text] if language == "German" else text
        # Of the sidebar of 280 pixels, a panel has 226: half of it, less the margins of a button and its icon.
        assert blf.dimensions(0, shown)[0] <= 113 - 8 - (20 if has_icon else 0), shown
