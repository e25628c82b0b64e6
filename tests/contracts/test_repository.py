"""Rules of the repository that a newcomer could not guess."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

from tests.conftest import ROOT

from .sources import nodes, parsed

PACKAGES = ("engine", "gaussian_heritage_addon", "operators")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def tracked_files() -> list[Path]:
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()]


def is_ours(name: str) -> bool:
    return name.split(".")[0] in PACKAGES


def test_modules_say_what_they_are_and_import_relatively() -> None:
    silent, absolute = [], []
    for module in MODULES:
        source, name = module.read_text(encoding="utf-8"), str(module.relative_to(ROOT))
        silent += [] if ast.get_docstring(parsed(source)) else [name]
        for node in nodes(source):
            if isinstance(node, ast.Import):
                absolute += [name for alias in node.names if is_ours(alias.name)]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                absolute += [name] if is_ours(node.module or "") else []
    assert (silent, absolute) == ([], []), "modules without a docstring, and with absolute imports of ours"


def test_modules_of_the_addon_that_scripts_and_benchmarks_name_exist() -> None:
    """They import it from a link or by a text, which no type check follows."""
    missing = []
    for file in (one for one in tracked_files() if one.suffix == ".py"):
        for name in re.findall(r"gaussian_heritage_addon((?:\.\w+)+)", file.read_text(encoding="utf-8")):
            module = (ROOT / "gaussian_heritage_addon").joinpath(*name.strip(".").split("."))
            if name not in (".register", ".unregister") and not (
                module.with_suffix(".py").is_file() or module.is_dir()
            ):
                missing.append(f"{file.relative_to(ROOT)}: {name}")
    assert not missing


def test_extension_entry_imports_only_inside_register() -> None:
    tree = parsed((ROOT / "__init__.py").read_text())
    assert not any(isinstance(node, ast.Import | ast.ImportFrom) for node in tree.body)


def test_no_file_is_longer_than_two_things() -> None:
    long = {str(path.relative_to(ROOT)): n for path in MODULES if (n := len(path.read_text().splitlines())) > 520}
    assert long == {}


def test_no_machine_path_is_committed() -> None:
    pattern = re.compile(r"/(?:work|root|home/\w+)/(?!\.config)[\w.]")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()[:80]}"
        for path in tracked_files()
        if path.suffix in {".py", ".md", ".toml", ".json", ".txt", ".in", ".html", ".svg", ".yaml"}
        and path.name != "test_repository.py"
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines()
        if pattern.search(line)
    ]
    assert found == []


def test_every_picture_of_docs_is_named_by_a_document() -> None:
    docs, files = ROOT / "docs", tracked_files()
    documents = [one for one in files if one.suffix == ".md" and (docs in one.parents or one.parent == ROOT)]
    pictures = [one for one in files if docs in one.parents and one.suffix in {".jpg", ".png", ".svg", ".webm"}]
    text = "".join(one.read_text(encoding="utf-8") for one in documents)
    named = {name.removeprefix("docs/") for name in re.findall(r"[\w./-]+\.(?:jpg|png|svg|webm)", text)}
    assert [str(one.relative_to(docs)) for one in pictures if one.relative_to(docs).as_posix() not in named] == []
    assert pictures


def test_tracked_files_stay_small() -> None:
    assert sum(path.stat().st_size for path in tracked_files()) < 50 * 2**20  # 50 MiB
