"""Windows' Python under Wine: what is installed, which tests are left out, and how failing steps are told."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


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
    for test, reason in left_out.NOT_ON_WINDOWS.items():
        file, _, function = test.partition("::")
        assert f"def {function.partition('[')[0]}(" in (ROOT / file).read_text(encoding="utf-8"), test
        assert len(reason) > 10 and any(
            test.startswith(paths) for paths in (*left_out.GROUPS.values(), left_out.BLENDER)
        ), test


def test_paths_are_named_as_windows_programs_see_them(tmp_path: Path) -> None:
    windows = module("windows.launch").Windows(tmp_path, "one")
    assert windows.windows(windows.home / "a b" / "c.txt") == rf"C:\users\{windows.home.name}\a b\c.txt"
    assert windows.windows(Path("/srv/x.txt")) == r"Z:\srv\x.txt"


def test_what_needs_a_failed_step_is_not_run_and_a_fault_does_not_end_the_others(tmp_path: Path) -> None:
    steps, problem = module("windows.steps"), module("windows.problem").Problem
    test = module("windows_test")
    ran = []

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
    )
    assert [one.passed for one in results] == [False, False, False, True] and ran == [1]
    text = test.document(results)
    assert r"| set up | **failed** | no Python \| found |" in text and "| files | passed | 12 files |" in text
    assert "it needs: set up" in text
