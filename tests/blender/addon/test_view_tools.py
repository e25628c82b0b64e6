"""Tools that wait for the mouse in a 3D view: one at a time, named in the header, and left by Escape."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from conftest import Part
from test_clicking import Tool, Window

TOOLS = [
    ("measure_scene", "HERITAGE_OT_measure", {"action": "NORTH", "points_on_photos": ()}, "North"),
    ("measure_scene", "HERITAGE_OT_measure", {"action": "DISTANCE", "points_on_photos": ()}, "Known Distance"),
    ("measure_scene", "HERITAGE_OT_measure", {"action": "RULER", "points_on_photos": ()}, "Ruler"),
    ("pick_object", "HERITAGE_OT_pick_object", {"action": "SELECT", "photo": ""}, "Select in View"),
    ("pick_object", "HERITAGE_OT_pick_object", {"action": "ISOLATE", "photo": ""}, "Isolate in View"),
    ("edit_region", "HERITAGE_OT_edit_region", {"action": "ADD", "shape": "LASSO", "path": ()}, "Add by Lasso"),
    ("edit_region", "HERITAGE_OT_edit_region", {"action": "TAKE", "shape": "BOX", "path": ()}, "Take by Box"),
    ("click_object", "HERITAGE_OT_click_object", {"refine": False}, "Click Object"),
    ("click_object", "HERITAGE_OT_click_object", {"refine": True}, "Correct by Clicks"),
]
"""Module, operator, options and name of each tool that waits for the mouse."""


@pytest.fixture
def tools(opened: Any, part: Part) -> list[tuple[Tool, str]]:
    """All tools in the same view, with their names."""
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    window = Window()
    return [
        (Tool(getattr(part(f"operators.{module}"), operator), window, **options), name)
        for module, operator, options, name in TOOLS
    ]


def test_header_names_the_tool_and_how_to_leave_it_and_escape_leaves_it(tools: list[tuple[Tool, str]]) -> None:
    for tool, name in tools:
        assert tool.invoke() == {"RUNNING_MODAL"}
        assert tool.window.header.startswith(f"{name}: ") and "Esc: leave" in tool.window.header
        # Wherever the pointer is: here on the sidebar.
        assert tool.event("ESC", (620, 230)) == {"CANCELLED"}
        assert tool.window.header is None


def test_new_tool_ends_the_former_which_takes_no_further_click(tools: list[tuple[Tool, str]]) -> None:
    for (former, _), (new, name) in zip(tools, [*tools[1:], tools[0]], strict=True):
        former.invoke()
        assert new.invoke() == {"RUNNING_MODAL"}
        assert former.event("LEFTMOUSE") == {"CANCELLED", "PASS_THROUGH"}
        assert new.window.header.startswith(f"{name}: ")
        new.event("ESC")
        assert new.window.header is None


def test_header_is_written_again_after_blender_has_used_it(tools: list[tuple[Tool, str]]) -> None:
    tool, name = tools[0]
    tool.invoke()
    assert tool.event("G") == {"PASS_THROUGH"}
    tool.window.header = None  # Moving an object has ended.
    tool.event("MOUSEMOVE")
    assert tool.window.header.startswith(f"{name}: ")


def test_tool_ends_when_its_scene_or_its_view_is_left(tools: list[tuple[Tool, str]]) -> None:
    tool, _ = tools[0]
    tool.invoke()
    tool.context.scene = bpy.data.scenes.new("other")
    assert tool.event("LEFTMOUSE") == {"CANCELLED", "PASS_THROUGH"}
    tool.context.scene = bpy.context.scene
    tool.invoke()
    tool.context.window_manager.windows[0].screen = SimpleNamespace(areas=[])
    assert tool.event("LEFTMOUSE") == {"CANCELLED", "PASS_THROUGH"}
