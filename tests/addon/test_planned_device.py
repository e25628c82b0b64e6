"""The panel knows what a reconstruction trains on, as far as the engine has planned it."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

from .conftest import PACKAGE

planned_device = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.planned_device").planned_device


def write_plan(project: Path, plan: object) -> None:
    (project / "project.json").write_text(
        json.dumps({"version": 1, "stages": {}, "earlier_outputs": {}, "work_plan": plan})
    )


def test_card_is_named_and_the_processor_with_the_reason(tmp_path: Path) -> None:
    assert planned_device(tmp_path) is None
    write_plan(tmp_path, {"device": {"name": "Card (Vulkan)", "reason": ""}})
    assert planned_device(tmp_path) == ("Card (Vulkan)", "")
    other = tmp_path / "other"
    other.mkdir()
    write_plan(other, {"device": {"name": "cpu", "reason": "this computer has no graphics card"}})
    assert planned_device(other) == ("cpu", "this computer has no graphics card")


@pytest.mark.parametrize("plan", [None, {}, {"device": 5}, {"device": {"name": "cpu"}}])
def test_plan_without_a_device_says_nothing(tmp_path: Path, plan: object) -> None:
    write_plan(tmp_path, plan)
    assert planned_device(tmp_path) is None
