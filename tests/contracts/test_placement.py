"""One module asks where an object stands: Blender leaves ``matrix_world`` stale where it does not evaluate."""

from __future__ import annotations

import ast

import pytest

from tests.conftest import ROOT

from .sources import nodes

FOLDERS = ("gaussian_heritage_addon", "operators")
CHECKED = ROOT / "gaussian_heritage_addon" / "blender" / "world_placement.py"
STALE = ("matrix_world", "matrix_local")
"""What Blender computes when it evaluates an object; ``matrix_basis`` are the object's own channels."""


def uses(source: str) -> list[int]:
    """Return the lines that read or set a stale matrix, also by its name as text (``getattr``, paths of properties)."""
    found = []
    for node in nodes(source):
        by_name = isinstance(node, ast.Attribute) and node.attr in STALE
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value
        if by_name or (is_text and any(name in node.value for name in STALE)):
            found.append(node.lineno)
    return found


def test_only_one_module_uses_what_blender_evaluates() -> None:
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    assert CHECKED in files
    wrong = [
        f"{file.relative_to(ROOT)}:{line}: use world_placement"
        for file in files
        if file != CHECKED
        for line in uses(file.read_text(encoding="utf-8"))
    ]
    assert not wrong


@pytest.mark.parametrize(
    "source",
    [
        "place = obj.matrix_world @ point",
        "obj.matrix_world = place",
        "obj.matrix_world.translation.x += 1",
        "getattr(obj, 'matrix_world')",
        "obj.path_resolve('parent.matrix_local')",
        "children = [child.matrix_local for child in obj.children]",
    ],
)
def test_every_use_is_found(source: str) -> None:
    assert uses(source) == [1]


def test_channels_and_sentences_are_allowed() -> None:
    assert not uses("'''Return matrix_world of it.'''\nobj.matrix_basis = obj.matrix_parent_inverse")
