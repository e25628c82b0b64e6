"""The public names of a package, imported or defined by its ``__init__.py``, are there whatever was imported before."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .sources import parsed


def public_names(face: Path) -> set[str]:
    """What an ``__init__.py`` imports from its modules, also below ``if TYPE_CHECKING:``, or defines."""
    names, statements = set(), parsed(face.read_text(encoding="utf-8")).body
    for node in [*statements, *(inner for one in statements if isinstance(one, ast.If) for inner in one.body)]:
        if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return {name for name in names if not name.startswith("_") or name == "__version__"}


FACES = {
    ".".join(file.parent.relative_to(ROOT).parts): public_names(file)
    for folder in ("engine", "gaussian_heritage_addon", "operators")
    for file in sorted((ROOT / folder).rglob("__init__.py"))
    # A folder that only groups others has a docstring alone.
    if len(parsed(file.read_text(encoding="utf-8")).body) > 1
}
PACKAGES = [name for name in FACES if name.startswith("engine.")]


def test_every_package_lists_its_public_names() -> None:
    assert [name for name, names in FACES.items() if not names] == []


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_can_be_imported(name: str) -> None:
    package = importlib.import_module(name)
    for public in FACES[name]:
        assert getattr(package, public) is not None
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        package.nothing_of_this_name  # noqa: B018


@pytest.mark.parametrize("name", PACKAGES)
def test_no_public_name_is_that_of_a_module(name: str) -> None:
    """``from ..training import train`` would give the module ``train`` once anybody had imported it."""
    folder = ROOT.joinpath(*name.split("."))
    modules = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert FACES[name] & modules == set()
