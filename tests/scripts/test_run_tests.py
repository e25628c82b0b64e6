"""`make test` runs every part, also after one failed, and says at the end what failed."""

from __future__ import annotations

import importlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import PATIENCE, ROOT

MAKE = shutil.which("make")
PARTS = ["lint", "contracts", "engine-tests", "blender-tests"]
NEEDS_MAKE = pytest.mark.skipif(MAKE is None, reason="needs make")


def run_tests(folder: Path, *failing: str) -> subprocess.CompletedProcess[str]:
    """Run the script in a folder whose Makefile notes each part, of which some fail."""
    rules = [f"{part}:\n\t@echo {part} >> ran.txt; exit {int(part in failing)}\n" for part in PARTS]
    (folder / "Makefile").write_text("".join(rules))
    (folder / "ran.txt").unlink(missing_ok=True)
    lines = [
        f"import sys; sys.path.insert(0, {str(ROOT / 'scripts')!r})",
        "from pathlib import Path; from run_tests import run_parts",
        f"sys.exit(run_parts({PARTS}, {MAKE!r}, Path.cwd()))",
    ]
    command = [sys.executable, "-c", "\n".join(lines)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE)


@NEEDS_MAKE
@pytest.mark.parametrize("failing", [["lint"], ["contracts", "engine-tests"], PARTS])
def test_every_part_runs_and_the_failed_ones_are_told_at_the_end(failing: list[str], tmp_path: Path) -> None:
    done = run_tests(tmp_path, *failing)
    assert done.returncode == 1
    assert (tmp_path / "ran.txt").read_text().split() == PARTS
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"{len(failing)} of 4 parts failed: ")
    assert re.findall(r"([a-z-]+) \(exit code", last) == failing


@NEEDS_MAKE
def test_without_a_failure_the_exit_code_is_0(tmp_path: Path) -> None:
    done = run_tests(tmp_path)
    assert done.returncode == 0 and "All 4 parts passed" in done.stdout
    assert (tmp_path / "ran.txt").read_text().split() == PARTS


def test_make_test_and_ci_run_all_parts_to_their_ends() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(r"^test: .*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert recipe is not None and f'run_tests.py --make "$(MAKE)" {" ".join(PARTS)}' in recipe[1]
    assert "\nmake test\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for part in ("engine-tests", "blender-tests"):
        lines = re.search(rf"^{part}: .*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
        assert lines is not None and not re.search(r"\s(-x|--exitfirst|--maxfail\S*)\s", lines[1])
    for settings in ("pyproject.toml", "tests/blender/pytest.ini"):
        options = re.findall(r"^addopts.*", (ROOT / settings).read_text(encoding="utf-8"), re.MULTILINE)
        assert not any(re.search(r"-x\b|--exitfirst|--maxfail", line) for line in options)


def test_every_test_runs_in_the_newest_blender_and_fewer_in_those_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    left_out_in = importlib.import_module("run_blender_tests").left_out_in
    blenders = ["blender-4.5", "blender-5.2", "blender-5.3"]
    assert [left_out_in(one, blenders) for one in blenders] == [["once"], ["slow", "once"], []]
    assert left_out_in("blender-4.5", ["blender-4.5"]) == []
