"""docs/architecture.md and docs/where.md are true: the picture shows all packages, arrows are imports, places exist."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .sources import nodes, parsed

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PICTURE = PAGE.partition("```mermaid")[2].partition("```")[0]
WHERE = (ROOT / "docs" / "where.md").read_text(encoding="utf-8")
PLACES = re.findall(r"^\| (?P<what>[^|]+) \| `(?P<file>[^`]+)` \| `(?P<name>[^`]+)` \|$", WHERE, re.MULTILINE)

ARROW = re.compile(r"\s*(?P<kind>-->|==>|-\. \"[^\"]*\" \.->|== \"[^\"]*\" ==>)\s*")
KINDS = {"-": "uses", "=": "data", ".": "process"}


def arrows() -> list[tuple[str, str, str]]:
    """All arrows of the picture as (start, kind, end)."""
    found = []
    for line in PICTURE.splitlines():
        parts = ARROW.split(line.strip())
        for start, kind, ends in zip(parts[0::2], parts[1::2], parts[2::2], strict=False):
            meaning = "process" if kind.startswith("-.") else KINDS[kind[0]]
            found += [(_name(start), meaning, _name(end)) for end in ends.split(" & ")]
    return found


def _name(node: str) -> str:
    return node.partition("[")[0].strip()


def files_of(name: str) -> list[Path]:
    if name == "addon":
        return sorted((ROOT / "gaussian_heritage_addon").rglob("*.py"))
    if name == "operators":
        return sorted((ROOT / "operators").glob("*.py"))
    return sorted((ROOT / "engine" / name).rglob("*.py"))


@functools.cache
def imported_by(name: str) -> set[str]:
    """The packages and modules of ours that the files of `name` import from."""
    names = set()
    for file in files_of(name):
        for node in nodes(file.read_text(encoding="utf-8")):
            if isinstance(node, ast.ImportFrom) and node.level:
                parts = (node.module or "").split(".")
                names |= {"addon" if part == "gaussian_heritage_addon" else part for part in parts}
                names |= {alias.name for alias in node.names} if node.module is None else set()
    return names


def test_picture_shows_every_package_of_the_engine() -> None:
    packages = {path.parent.name for path in (ROOT / "engine").glob("*/__init__.py")}
    shown = {name for start, _, end in arrows() for name in (start, end)}
    assert packages - shown == set()
    assert all(files_of(name) for name in shown), shown


@pytest.mark.parametrize(("start", "kind", "end"), arrows(), ids=[" ".join(arrow) for arrow in arrows()])
def test_every_arrow_is_true(start: str, kind: str, end: str) -> None:
    if kind == "uses":
        assert end in imported_by(start)
    elif kind == "data":
        assert start in imported_by(end) or {start, end} <= imported_by("pipeline")
        assert end not in imported_by(start), "data flows one way"
    else:
        assert end not in imported_by(start), "another process is not imported"


@pytest.mark.parametrize("folder", ["engine", "gaussian_heritage_addon"])
def test_tables_name_every_folder_in_the_order_of_imports(folder: str) -> None:
    table = PAGE.partition(f"| folder of `{folder}` | what it holds |")[2].partition("\n\n")[0]
    named = [
        name
        for row in table.splitlines()
        if row.startswith("| `")
        for name in re.findall(r"`(\w+)`", row.split("|")[1])
    ]
    contract = {"engine": "parts-in-order", "gaussian_heritage_addon": "add-on-in-order"}[folder]
    contracts = (ROOT / ".importlinter").read_text(encoding="utf-8")
    order = contracts.partition(f"[importlinter:contract:{contract}]")[2].partition("\n\n")[0]
    places = [re.search(rf"^\s+(gaussian_heritage\.engine\.)?{name}$", order, re.MULTILINE) for name in named]
    assert all(places) and {path.parent.name for path in (ROOT / folder).glob("*/__init__.py")} == set(named)
    starts = [place.start() for place in places if place]
    assert starts == sorted(starts)


def test_every_kind_of_arrow_is_read() -> None:
    kinds = [kind for _, kind, _ in arrows()]
    assert (kinds.count("process"), kinds.count("data")) == (1, 6)
    assert kinds.count("uses") == len(re.findall(r"-->|&", PICTURE)) > 15


@pytest.mark.parametrize(("what", "file", "name"), PLACES, ids=[what for what, _, _ in PLACES])
def test_every_place_exists(what: str, file: str, name: str) -> None:
    tree = parsed((ROOT / file).read_text(encoding="utf-8"))
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        defined |= {target.id for target in targets if isinstance(target, ast.Name)}
    assert name in defined, what


def test_every_row_of_the_table_is_read() -> None:
    heads = 2 * WHERE.count("\n## ")
    assert len(PLACES) == sum(line.startswith("| ") for line in WHERE.splitlines()) - heads > 20
