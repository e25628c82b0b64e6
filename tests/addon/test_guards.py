"""Blender gets our functions from one module only, which puts a guard around each. tests/blender checks the guards."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from .conftest import ROOT

GUARDS = ROOT / "gaussian_heritage_addon" / "blender" / "guards.py"
FILES = sorted(
    [ROOT / "__init__.py", *(ROOT / "gaussian_heritage_addon").rglob("*.py"), *(ROOT / "operators").rglob("*.py")]
)
CALLS = {"register_class", "register_classes_factory", "draw_handler_add", "subscribe_rna", "register_tool"}
LISTS = {"append", "prepend", "insert"}
PROPERTY_CALLBACKS = {"update", "get", "set", "search", "poll"}


def registrations(source: str) -> list[str]:
    """Return the places where `source` gives Blender a function without a guard, as line and call."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        target, name = ast.unparse(node.func.value), node.func.attr
        unguarded = (
            (name in CALLS and target != "guards")
            or (name == "register" and target.endswith("timers"))
            or (name in LISTS and ("bpy.types." in target or "handlers" in target))
        )
        if unguarded:
            found.append(f"{node.lineno}: {target}.{name}")
    return found


def unguarded_properties(source: str) -> list[str]:
    """Return the properties with callbacks that are not declared in a class, which `register_class` would not see."""
    tree = ast.parse(source)
    declared = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.AnnAssign)}
    return [
        f"{node.lineno}: {ast.unparse(node.func)}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).endswith("Property")
        and any(keyword.arg in PROPERTY_CALLBACKS for keyword in node.keywords)
        and id(node) not in declared
    ]


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_everything_that_blender_calls_is_registered_with_a_guard(file: Path) -> None:
    source = file.read_text(encoding="utf-8")
    assert unguarded_properties(source) == []
    if file != GUARDS:
        assert registrations(source) == []


@pytest.mark.parametrize(
    "line",
    [
        "bpy.utils.register_class(cls)",
        "bpy.app.timers.register(poll)",
        "bpy.app.handlers.load_post.append(changed)",
        "bpy.types.TOPBAR_MT_file_import.append(draw)",
        "bpy.types.SpaceView3D.draw_handler_add(draw, (), 'WINDOW', 'POST_PIXEL')",
        "bpy.msgbus.subscribe_rna(key=key, owner=owner, args=(), notify=notify)",
    ],
)
def test_registration_without_a_guard_is_found(line: str) -> None:
    assert len(registrations(line)) == 1
    assert unguarded_properties("bpy.types.Scene.x = StringProperty(update=changed)") != []
