"""What a docstring describes is what the signature takes. A parameter whose name and type say all has no entry."""

from __future__ import annotations

import ast
import re

from tests.conftest import ROOT

from .sources import nodes, parsed

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


def wrong_promises(source: str) -> list[str]:
    """What is wrong with the docstrings of a module."""
    wrong = []
    for node in nodes(source):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = described(ast.get_docstring(node) or "")
            if names is not None and names != [name for name in taken(node) if name in names]:
                wrong.append(f"{node.name} describes {names} and takes {taken(node)}")
    for node in parsed(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            wrong += [] if ast.get_docstring(node) else [f"{node.name} does not say what the caller gets"]
    return wrong


def test_docstrings_describe_what_is_taken_and_say_what_the_caller_gets() -> None:
    found = {str(module.relative_to(ROOT)): wrong_promises(module.read_text(encoding="utf-8")) for module in MODULES}
    assert {module: wrong for module, wrong in found.items() if wrong} == {}


def test_wrong_names_and_silence_are_found() -> None:
    docstring = '"""Return it.\n\n    Parameters\n    ----------\n    {} : int\n        Some.\n    """'
    for names, is_right in (("a", True), ("b", True), ("a, b", True), ("a, c", False), ("b, a", False)):
        source = f"def f(a, *, b=1):\n    {docstring.format(names)}"
        assert (wrong_promises(source) == []) == is_right, names
    assert wrong_promises("def f(): ...") == ["f does not say what the caller gets"]
