"""What a docstring describes is what the signature takes. A parameter whose name and type say all has no entry."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("engine", "gaussian_heritage_addon", "operators")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

# A section's entries stand at the docstring's own indentation: "means, quats : Tensor of shape [N, 3]".
SECTION = re.compile(r"^Parameters\n-+\n(?P<body>.*?)(?=^\S[^\n]*\n-+\n|\Z)", re.DOTALL | re.MULTILINE)
ENTRY = re.compile(r"^(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: ?:.*)?$", re.MULTILINE)


def described(docstring: str) -> list[str] | None:
    """The parameters that a numpydoc section lists; None without such a section."""
    section = SECTION.search(docstring)
    if section is None:
        return None
    return [name.lstrip("*") for entry in ENTRY.finditer(section["body"]) for name in entry["names"].split(", ")]


def taken(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """The parameters of a signature, in order."""
    arguments = function.args
    plain = [*arguments.posonlyargs, *arguments.args]
    every = [*plain, *([arguments.vararg] if arguments.vararg else []), *arguments.kwonlyargs]
    every += [arguments.kwarg] if arguments.kwarg else []
    return [argument.arg for argument in every if argument.arg not in ("self", "cls")]


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_described_parameters_are_the_ones_taken(module: Path) -> None:
    wrong = []
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = described(ast.get_docstring(node) or "")
            if names is not None and names != [name for name in taken(node) if name in names]:
                wrong.append(f"{node.name} describes {names} and takes {taken(node)}")
    assert wrong == []


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_public_names_say_what_the_caller_gets(module: Path) -> None:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    public = [
        node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
    ]
    assert [node.name for node in public if not ast.get_docstring(node)] == []


def test_the_reader_of_docstrings_sees_a_wrong_name() -> None:
    source = (
        'def f(a, *, b=1):\n    """Return it.\n\n    Parameters\n    ----------\n    a, c : int\n        Some.\n    """'
    )
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    assert described(ast.get_docstring(function) or "") == ["a", "c"]
    assert taken(function) == ["a", "b"]
