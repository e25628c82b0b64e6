"""The text of the plan says what will be decided during training."""

from __future__ import annotations

from pathlib import Path

from engine.core.system import Machine
from engine.pipeline.planning.calibration import REFERENCE, Calibration
from engine.pipeline.planning.decisions import training_settings
from engine.pipeline.planning.forecast import forecast_work
from engine.pipeline.planning.plan_text import format_plan

from .scenes import work


def text(n: int) -> str:
    plan = work(n)
    machine = Machine(2, 16_000_000_000, "cpu", "test")
    calibration = Calibration(Path("calibration.json"), "key", REFERENCE)
    return format_plan(plan, forecast_work(plan, training_settings(plan), machine, calibration))


def test_trials_are_announced_where_there_are_enough_photos_for_them() -> None:
    few, enough = text(26), text(27)
    words = "colour bands up to degree 1, if a trial shows a gain"
    assert words in enough and words not in few
    assert "trials during training: 23 training photos are too few" in few


def test_test_photos_are_counted() -> None:
    assert "test photos 3, to measure the error" in text(27)
    assert "test photos none" in text(3)
