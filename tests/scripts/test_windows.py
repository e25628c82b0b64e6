"""Windows' Python under Wine: what is installed, which tests are left out, and how failing steps are told."""

from __future__ import annotations

import importlib
import re
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

from tests.conftest import ROOT


@pytest.fixture(autouse=True)
def _scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))


def module(name: str) -> ModuleType:
    return importlib.import_module(name)


def test_windows_gets_its_own_packages_with_their_hashes_and_no_markers(tmp_path: Path) -> None:
    locked = tmp_path / "locked.txt"
    locked.write_text(
        "# A list.\n"
        "numpy==2.4.0 \\\n    --hash=sha256:aa \\\n    --hash=sha256:bb\n"
        "colorama==0.4.6 ; sys_platform == 'win32' \\\n    --hash=sha256:cc\n"
        "uvloop==0.22 ; sys_platform != 'win32' \\\n    --hash=sha256:dd\n"
    )
    lines = module("windows.packages").windows_lines([locked, locked])
    assert lines == [
        "numpy==2.4.0 \\\n    --hash=sha256:aa \\\n    --hash=sha256:bb\n",
        "colorama==0.4.6 \\\n    --hash=sha256:cc\n",
    ]


def test_all_packages_of_the_engine_and_its_tests_are_installed() -> None:
    packages = module("windows.packages")
    names = {line.partition("==")[0] for line in packages.windows_lines(packages.LOCKED["tests"])}
    assert {"torch", "pycolmap", "colorama", "pytest", "hypothesis", "pip"} <= names
    assert set(packages.LOCKED) == set(module("windows.launch").ENVIRONMENTS)


def test_tests_that_are_left_out_exist_and_have_a_reason() -> None:
    left_out = module("windows.linux_only")
    for paths in left_out.GROUPS.values():
        assert all((ROOT / path).exists() for path in paths)
    assert set(left_out.QUICK) <= set(left_out.GROUPS)
    in_blender = sorted(left_out.BLENDER + file for files in left_out.IN_BLENDER.values() for file in files)
    tests = (ROOT / left_out.BLENDER).rglob("test_*.py")
    assert in_blender == sorted(file.relative_to(ROOT).as_posix() for file in tests)
    for test, reason in left_out.NOT_ON_WINDOWS.items():
        file, _, function = test.partition("::")
        assert f"def {function.partition('[')[0]}(" in (ROOT / file).read_text(encoding="utf-8"), test
        assert len(reason) > 10 and any(
            test.startswith(paths) for paths in (*left_out.GROUPS.values(), left_out.BLENDER)
        ), test


def test_tests_that_windows_runs_read_text_as_the_product_writes_it() -> None:
    """Windows' Python reads in the code page of the language, in which a user's name need not exist."""
    left_out = module("windows.linux_only")
    paths = [ROOT / path for path in (*sum(left_out.GROUPS.values(), ()), left_out.BLENDER)]
    files = [file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py"))]
    assert len(files) > 100
    assert [file.name for file in files if ".read_text()" in file.read_text(encoding="utf-8")] == []


def test_paths_are_named_as_windows_programs_see_them(tmp_path: Path) -> None:
    windows = module("windows.launch").Windows(tmp_path, "one")
    assert windows.windows(windows.home / "a b" / "c.txt") == rf"C:\users\{windows.home.name}\a b\c.txt"
    assert windows.windows(Path("/srv/x.txt")) == r"Z:\srv\x.txt"


def test_what_needs_a_failed_step_is_not_run_and_a_fault_does_not_end_the_others(tmp_path: Path) -> None:
    steps, problem = module("windows.steps"), module("windows.problem").Problem
    test = module("windows_test")
    ran: list[int] = []
    told: list[object] = []

    def refuse(context: object) -> str:
        raise problem("no Python | found")

    def fault(context: object) -> str:
        raise KeyError("x")

    def run(context: object) -> str:
        ran.append(1)
        return "12 files"

    results = test.run_steps(
        [
            steps.Step("set up", refuse),
            steps.Step("segment", run, ("set up",)),
            steps.Step("fault", fault),
            steps.Step("files", run),
        ],
        steps.Context(tmp_path, tmp_path),
        told.append,
    )
    assert told == results
    assert [one.passed for one in results] == [False, False, False, True] and ran == [1]
    text = test.document(results, ["files", "set up", "segment", "export"], "0123abcd")
    rows = [line for line in text.splitlines() if line.startswith("| ")][2:]
    assert rows[0] == "| files | passed | 0123abcd | 12 files |"
    assert rows[1] == r"| set up | **failed** | 0123abcd | no Python \| found |"
    assert "it needs: set up" in rows[2] and rows[3].startswith("| export | **not run** |") and len(rows) == 4


def test_run_of_some_steps_keeps_the_rows_of_the_others_with_their_commits() -> None:
    steps, test = module("windows.steps"), module("windows_test")

    def result(name: str, text: str) -> object:
        return steps.Result(steps.Step(name, str), True, text)

    names = ["photos", "export", "export glb"]
    before = test.document([result("export", "12 kB"), result("gone", "x"), result("photos", "9")], names, "0123abcd")
    after = test.document([result("photos", "10")], names, "4567abcd and changes", before)
    assert [line for line in after.splitlines() if line.startswith("| ")][2:] == [
        "| photos | passed | 4567abcd and changes | 10 |",
        "| export | passed | 0123abcd | 12 kB |",
        "| export glb | **not run** | | |",
    ]


def test_commit_of_the_product_says_that_files_were_changed_since(tmp_path: Path) -> None:
    def git(*words: str) -> None:
        subprocess.run(["git", "-c", "user.name=x", "-c", "user.email=x", *words], cwd=tmp_path, check=True)

    git("init", "--quiet")
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "windows.md").write_text("1")
    git("add", ".")
    git("commit", "--quiet", "-m", "x")
    commit_of = module("windows_test").commit_of
    (tmp_path / "docs" / "windows.md").write_text("2")
    assert re.fullmatch("[0-9a-f]{8}", commit_of(tmp_path))
    (tmp_path / "a.py").write_text("2")
    assert commit_of(tmp_path).endswith(" and changes")


def test_run_of_tests_that_was_ended_tells_what_failed_and_where_it_was_ended() -> None:
    told = module("windows.test_steps").told
    lines = [
        r"tests\test_a.py::test_one[a b/c] PASSED [  1%]",
        r"tests\test_a.py::test_two[a pipe] FAILED [ 50%]",
        r"tests\test_b.py::test_three SKIPPED (no gpu) [ 70%]",
    ]
    ended = "\n".join([*lines, r"tests\test_b.py::test_four ", "Timeout (0:04:00)!"])
    assert told(ended) == (
        "pytest was ended after 4 tests, 1 failed, in test_b.py::test_four: test_a.py::test_two[a pipe]"
    )
    whole = "\n".join([*lines, "= summary =", "=== 1 failed, 1 passed, 1 skipped in 12.30s (0:00:12) ==="])
    assert told(whole) == "1 failed, 1 passed, 1 skipped: test_a.py::test_two[a pipe]"
