"""The packages that isolate objects stay small: lines, and numbers that someone chose.

Counted are, over the syntax trees of the package, each numeric literal that is no index and none of 0, 1, -1 and 2,
which stand for nothing, a whole, the last one and a pair, and each default of a setting, whatever its value.
Annotations are not code. A literal counts once where it stands: a number with a name that is used ten times is one.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "engine" / "objects"

MAX_LINES = 3550
"""Lines of the package, with what it shows of clicks and of refused texts; it had 5,945 with a chain of rules."""

MAX_NUMBERS = 45
"""Numbers of the package, counted as above; the chain of rules had 205."""

_PLAIN = (0, 1, -1, 2)


def numbers_in(tree: ast.AST) -> int:
    """Return how many numbers and settings a module has."""
    settings = [
        field.value
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and node.name.endswith("Settings")
        for field in node.body
        if isinstance(field, ast.AnnAssign) and field.value is not None
    ]
    inside = {id(part) for value in settings for part in ast.walk(value)}
    return len(settings) + sum(id(literal) not in inside for literal in _literals(tree))


def _literals(node: ast.AST) -> Iterator[ast.Constant]:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value not in _PLAIN:
        yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns") or (name == "slice" and isinstance(node, ast.Subscript)):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _literals(child)


def test_objects_have_few_lines_and_numbers() -> None:
    sources = [path.read_text(encoding="utf-8") for path in sorted(PACKAGE.glob("*.py"))]
    assert sum(source.count("\n") for source in sources) <= MAX_LINES
    assert sum(numbers_in(ast.parse(source)) for source in sources) <= MAX_NUMBERS


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("A = 0.3", 1),
        ("A = (3, 4.5)", 2),
        ("def f(x, y=7):\n    return 3 * x[4]", 2),
        ("A = 0\nB = -1\nC = 2.0", 0),
        ("class SegmentSettings:\n    on: bool = True\n    side: int = 480", 2),
        ("def f(x: Literal[3]) -> Tuple[4]:\n    pass", 0),
        ("A = True", 0),
    ],
)
def test_numbers_are_counted_as_stated(source: str, count: int) -> None:
    assert numbers_in(ast.parse(source)) == count
