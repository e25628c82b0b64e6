"""The window test: windows that share a root, and the time of the add-on apart from that of Blender's own tools."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

SCRIPT = ROOT / "scripts" / "window" / "window.sh"
PROGRAMS = {"xdotool": 'echo "$@" >>"$HOME/pressed"', **dict.fromkeys(("blender", "openbox", "Xvfb"), "exec sleep 600")}
NAMESPACE = ["unshare", "--mount", "--propagation", "private"]
MODULE = re.compile(
    r"(?:(?P<alias>\w+) = f?['\"]?)?\{?(?:__import__|importlib\.import_module|_module)\("
    r"(?:f?['\"]\{PACKAGE\}\.gaussian_heritage_addon\.|\{PACKAGE \+ \"\.gaussian_heritage_addon\.|['\"])"
    r"(?P<module>\w+\.\w+)['\"][^)]*\)\}?(?:\.(?P<name>\w+))?"
)
"""A module of the add-on in the text of a step, the name that it gets there, and what is taken of it at once."""
STEPS = """
export BLENDER_WINDOW_ROOT=$1/root BLENDER_WINDOW_SEES=/usr:/bin:/lib:/lib64:$1/programs PATH=$1/programs:$PATH
window() { BLENDER_WINDOW_WORK=$folder/$1 BLENDER_WINDOW_DISPLAY=$2 bash "$script" "${@:3}"; }
folder=$1 script=$2
trap 'window one :71 stop; window two :72 stop' EXIT
window one :71 start >/dev/null 2>&1 </dev/null
window two :72 start >/dev/null 2>&1 </dev/null
window one :71 key a
window one :71 stop
for pid in $(cat "$folder/two/pids"); do kill -0 "$pid"; done
window two :72 key b
"""


def _may_mount() -> bool:
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        return False
    return subprocess.run([*NAMESPACE, "true"], check=False).returncode == 0


@pytest.mark.skipif(not _may_mount(), reason="needs Linux, and a root that may mount")
def test_second_window_on_a_root_goes_on_when_the_first_one_ends(tmp_path: Path) -> None:
    # The system's own programs take the place of Debian's. Mounts of the test end with its own namespace.
    programs = tmp_path / "programs"
    programs.mkdir()
    for name, text in PROGRAMS.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    command = [*NAMESPACE, "bash", "-ec", STEPS, "test", tmp_path, SCRIPT]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "one/home/pressed").read_text() == "key a\n"
    assert (tmp_path / "two/home/pressed").read_text() == "key b\n"
    assert not [line for line in Path("/proc/mounts").read_text().splitlines() if str(tmp_path) in line]


def test_seconds_of_blenders_own_tools_are_told_and_not_held_against_the_add_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    module = importlib.import_module("window_report")
    calls = [
        {"name": "ViewTool.modal", "seconds": 1.0, "cpu": 0.37, "blender": 0.35},
        {"name": "ViewTool.modal", "seconds": 0.1, "cpu": 0.09, "blender": 0.0},
        {"name": "_poll", "seconds": 0.2, "cpu": 0.15, "blender": 0.0},
    ]
    (tmp_path / "calls.jsonl").write_text("".join(f"{json.dumps(call)}\n" for call in calls))
    text = module.report(tmp_path, 50.0, 9.0)
    assert "| `ViewTool.modal` | 0.370 | 0.090 | 1.000 |" in text
    assert module.calls_above_goals(tmp_path) == ["`_poll` took 0.15 CPU s of its own, more than 0.1 s"]


def names_in_steps() -> set[tuple[str, str, str]]:
    """Return what the steps take of modules of the add-on: file of the step, module, name."""
    found = set()
    for script in sorted((ROOT / "scripts").glob("window_*.py")):
        text = script.read_text(encoding="utf-8")
        for match in MODULE.finditer(text):
            # Taken at once, or later by the name that the module gets.
            used = re.findall(rf"(?<![.\w]){match['alias']}\}}?\.(\w+)", text) if match["alias"] else []
            taken = [match["name"]] if match["name"] else used
            found |= {(script.name, match["module"], name) for name in taken}
    return found


def test_steps_take_names_of_the_add_on_that_exist() -> None:
    """They stand in texts that only a window runs, where a renamed function would be noticed after half an hour."""
    names = names_in_steps()
    assert {script for script, _, _ in names} >= {"window_by_hand.py", "window_selection.py", "window_test.py"}
    missing = []
    for script, module, name in sorted(names):
        file = ROOT / "gaussian_heritage_addon" / f"{module.replace('.', '/')}.py"
        defined = rf"^(?:(?:async )?def |class )?{name}\b|^from .*\bimport\b.*\b{name}\b"
        if not file.is_file() or not re.search(defined, file.read_text(encoding="utf-8"), re.MULTILINE):
            missing.append(f"{script}: {module}.{name}")
    assert not missing
