"""Files that other programs read are as their schemas ask: workflows of public runners, citation, compose files."""

from __future__ import annotations

import json
import re
import sys
from importlib.resources import files
from typing import Any

import pytest
from ruamel.yaml import YAML

from tests.conftest import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SCHEMAS = "builtin_schemas/vendor"
KINDS = {
    **{f".github/workflows/{file.name}": "github-workflows.json" for file in WORKFLOWS},
    "CITATION.cff": "citation-file-format.json",
    "compose.yaml": "compose-spec.json",
    "compose.gpu.yaml": "compose-spec.json",
}
"""File to the schema that check-jsonschema has for it."""


def read(text: str) -> Any:
    """Read YAML 1.2, in which `on` is a word."""
    return YAML(typ="safe", pure=True).load(text)


def refusals(text: str, schema: str) -> list[str]:
    """Return what a schema says against the text of a YAML file."""
    import jsonschema  # three seconds of CPU time, which every process of the tests would pay

    rules = json.loads(files("check_jsonschema").joinpath(SCHEMAS, schema).read_text(encoding="utf-8"))
    return [error.message for error in jsonschema.Draft7Validator(rules).iter_errors(read(text))]


def jobs() -> list[dict[str, Any]]:
    return [job for file in WORKFLOWS for job in read(file.read_text(encoding="utf-8"))["jobs"].values()]


def values(job: dict[str, Any], name: str) -> list[str]:
    return list(job["strategy"]["matrix"].get(name, []))


@pytest.mark.parametrize("name", KINDS)
def test_file_is_what_its_schema_asks_for(name: str) -> None:
    assert refusals((ROOT / name).read_text(encoding="utf-8"), KINDS[name]) == []


@pytest.mark.parametrize("change", [("runs-on:", "runs-in:"), ("steps:", "steps: 3\n    other:"), ("\non:", "\noff:")])
def test_wrong_workflow_is_found(change: tuple[str, str]) -> None:
    text = WORKFLOWS[0].read_text(encoding="utf-8")
    assert change[0] in text
    assert refusals(text.replace(*change, 1), "github-workflows.json") != []


def test_every_target_that_a_workflow_makes_is_in_the_makefile() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert len(WORKFLOWS) == 2
    made = {target for job in jobs() for target in values(job, "target")}
    for workflow in WORKFLOWS:
        for line in re.findall(r"run: make (.*)", workflow.read_text(encoding="utf-8")):
            made |= {word for word in line.split() if re.fullmatch(r"[a-z-]+", word)}
    assert {"window-test", "web-test", "readers-test", "container-test", "windows-test", "setup", "lint"} <= made
    assert made <= targets


def test_every_blender_and_system_is_tested() -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    from places import BLENDERS

    (job,) = [job for job in jobs() if "suite" in job["strategy"]["matrix"]]
    assert values(job, "suite") == ["engine", *BLENDERS]
    assert [name.partition("-")[0] for name in values(job, "os")] == ["ubuntu", "windows", "macos"]
