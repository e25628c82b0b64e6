"""Blender and the web page tell how long the whole reconstruction still takes, as far as the engine has forecast it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from engine.workers.jobs import JobState, seconds_left_in_all

ESTIMATES = ("seconds", "low", "high", "cpu_seconds", "model_cpu_seconds")
SIZES = ("memory", "memory_low", "memory_high", "model_memory")
STAGES = [
    {"stage": stage, **dict.fromkeys(ESTIMATES, seconds), **dict.fromkeys(SIZES, 1)}
    for stage, seconds in (("cameras", 40.0), ("training", 100.0), ("report", 5.0))
]
FORECAST = {"stages": STAGES, "free_memory": None, "cores": 2, "n_runs": 0, "seconds": [145.0, 145.0, 145.0]}


def write_forecast(project: Path, forecast: object) -> None:
    (project / "project.json").write_text(
        json.dumps({"version": 1, "stages": {}, "earlier_outputs": {}, "forecast": forecast})
    )


def test_time_of_the_stages_to_come_is_added(tmp_path: Path) -> None:
    write_forecast(tmp_path, FORECAST)
    assert seconds_left_in_all(tmp_path, JobState(stage="cameras", fraction=0.25)) == 135.0
    assert seconds_left_in_all(tmp_path, JobState(stage="training", fraction=0.1, seconds_left=60.0)) == 65.0


def test_nothing_is_told_before_there_is_a_forecast(tmp_path: Path) -> None:
    assert seconds_left_in_all(tmp_path, JobState(stage="cameras")) is None
    write_forecast(tmp_path, FORECAST)
    assert seconds_left_in_all(tmp_path, JobState(stage="photos")) is None


@pytest.mark.parametrize("forecast", [None, 5, {"stages": 1}, {"stages": [1]}, {"stages": [{"stage": "cameras"}]},
                                      {"stages": [{"stage": "cameras", "seconds": -1e300}]}])  # fmt: skip
def test_damaged_forecast_is_not_shown(tmp_path: Path, forecast: object) -> None:
    write_forecast(tmp_path, forecast)
    assert seconds_left_in_all(tmp_path, JobState(stage="cameras")) is None
