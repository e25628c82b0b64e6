"""The workflow files for public runners are valid, and run what the Makefile and the lists of versions have."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SCHEMA = "vendor.github-workflows"


def refusal(*files: Path) -> str:
    """Return what check-jsonschema says against workflow files, empty when they are valid."""
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", SCHEMA, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr


def jobs() -> list[dict[str, Any]]:
    return [job for file in WORKFLOWS for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values()]


def values(job: dict[str, Any], name: str) -> list[str]:
    return list(job["strategy"]["matrix"].get(name, []))


def test_workflows_are_valid() -> None:
    assert len(WORKFLOWS) == 2
    assert refusal(*WORKFLOWS) == ""


@pytest.mark.parametrize("change", [("runs-on:", "runs-in:"), ("steps:", "steps: 3\n    other:"), ("on:", "off:")])
def test_wrong_workflow_is_found(change: tuple[str, str], tmp_path: Path) -> None:
    text = WORKFLOWS[0].read_text(encoding="utf-8")
    assert change[0] in text
    (tmp_path / "wrong.yml").write_text(text.replace(*change, 1), encoding="utf-8")
    assert refusal(tmp_path / "wrong.yml") != ""


def test_every_target_that_a_workflow_makes_is_in_the_makefile() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    made = {target for job in jobs() for target in values(job, "target")}
    for file in WORKFLOWS:
        for line in re.findall(r"run: make (.*)", file.read_text(encoding="utf-8")):
            made |= {word for word in line.split() if re.fullmatch(r"[a-z-]+", word)}
    assert {"window-test", "web-test", "readers-test", "container-test", "windows-test", "setup", "lint"} <= made
    assert made <= targets


def test_every_blender_and_system_is_tested() -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    from places import BLENDERS

    (job,) = [job for job in jobs() if "suite" in job["strategy"]["matrix"]]
    assert values(job, "suite") == ["engine", *BLENDERS]
    assert [name.partition("-")[0] for name in values(job, "os")] == ["ubuntu", "windows", "macos"]
