"""docs/architecture.md is true: its picture shows every package, its arrows are imports, its places exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PICTURE = PAGE.partition("```mermaid")[2].partition("```")[0]
PLACES = re.findall(r"^\| (?P<what>[^|]+) \| `(?P<file>[^`]+)` \| `(?P<name>[^`]+)` \|$", PAGE, re.MULTILINE)

DATA_FLOWS = {
    ("photos", "cameras"), ("cameras", "masks"), ("masks", "training"), ("training", "objects"), ("objects", "report"),
    ("planning", "stages"), ("gaussians", "training"), ("stages", "photos"),
}  # fmt: skip
"""Arrows of the picture that data take: the later package, or the stage that joins both, imports the earlier one."""
PROCESSES = {("addon", "cli")}
"""Arrows of the picture between two processes, which import nothing."""


def arrows() -> list[tuple[str, str]]:
    found = []
    for line in PICTURE.splitlines():
        if "-->" in line or "-- " in line:
            names = re.split(r"\s*-->\s*|\s*-- \"[^\"]*\" -->\s*", line.strip())
            names = [name.partition("[")[0].strip() for name in names]
            found += list(zip(names, names[1:], strict=False))
    return found


def files_of(name: str) -> list[Path]:
    if name == "addon":
        return sorted((ROOT / "gaussian_heritage_addon").glob("*.py"))
    if name == "operators":
        return sorted((ROOT / "operators").glob("*.py"))
    module = ROOT / "engine" / f"{name}.py"
    return [module] if module.exists() else sorted((ROOT / "engine" / name).rglob("*.py"))


def imported_by(name: str) -> set[str]:
    """The packages and modules of ours that the files of `name` import from."""
    names = set()
    for file in files_of(name):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                parts = (node.module or "").split(".")
                names |= {"addon" if part == "gaussian_heritage_addon" else part for part in parts}
                names |= {alias.name for alias in node.names} if node.module is None else set()
    return names


def test_picture_shows_every_package_of_the_engine() -> None:
    packages = {path.parent.name for path in (ROOT / "engine").glob("*/__init__.py")}
    shown = {name for arrow in arrows() for name in arrow} | set(re.findall(r"^\s+(\w+)\[", PICTURE, re.MULTILINE))
    assert packages - shown == set()
    assert all(files_of(name) for name in shown), shown


@pytest.mark.parametrize("arrow", arrows(), ids=" to ".join)
def test_every_arrow_is_an_import_or_a_flow_of_data(arrow: tuple[str, str]) -> None:
    start, end = arrow
    if arrow in PROCESSES:
        assert end not in imported_by(start)
    elif arrow in DATA_FLOWS:
        assert start in imported_by(end) | imported_by("stages") | imported_by("pipeline")
    else:
        assert end in imported_by(start)


def test_picture_has_the_arrows_that_this_test_knows() -> None:
    assert set(arrows()) >= DATA_FLOWS | PROCESSES
    assert len(arrows()) > 20


@pytest.mark.parametrize(("what", "file", "name"), PLACES, ids=[what for what, _, _ in PLACES])
def test_every_place_exists(what: str, file: str, name: str) -> None:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        defined |= {target.id for target in targets if isinstance(target, ast.Name)}
    assert name in defined, what


def test_every_row_of_the_table_is_read() -> None:
    table = PAGE.partition("## Where to find it")[2]
    assert len(PLACES) == sum(line.startswith("| ") for line in table.splitlines()) - 2 > 20
