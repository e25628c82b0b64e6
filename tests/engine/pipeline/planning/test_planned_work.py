"""A plan is stored once, also over what someone else stored, and considers the limits of the process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from engine.core.system import Machine
from engine.pipeline.planning.calibration import REFERENCE, Calibration
from engine.pipeline.planning.decisions import training_settings, work_plan_as_dict
from engine.pipeline.planning.forecast import forecast_as_dict, forecast_work
from engine.pipeline.planning.planned_work import store_forecast
from engine.project.folder import ProjectFolder

from .scenes import work


@pytest.mark.parametrize(
    "stored", [None, {}, {"stages": 5}, {"stages": [5]}, {"stages": [{"stage": None}]}, {"stages": [{"stage": "x"}]}]
)
def test_stored_forecast_of_any_kind_is_replaced(tmp_path: Path, stored: Any) -> None:
    plan = work(32)
    machine = Machine(2, 16_000_000_000, "cpu", "test")
    forecast = forecast_work(plan, training_settings(plan), machine, Calibration(tmp_path / "c", "key", REFERENCE))
    project = ProjectFolder.create(tmp_path / "project")
    project.put("work_plan", json.loads(json.dumps(work_plan_as_dict(plan))))
    project.put("forecast", stored)
    store_forecast(project, plan, forecast)
    expected = json.loads(json.dumps(forecast_as_dict(forecast)))
    assert project.get("forecast") == expected
    project.put("forecast", {**expected, "free_memory": 1})
    store_forecast(project, plan, forecast)
    assert project.get("forecast")["free_memory"] == 1, "the forecast of the first run is kept"
