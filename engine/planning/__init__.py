"""The plan of a run: what the scene needs, what is left out and why, and the forecast of time and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .benchmark import calibrate
    from .calibration import Calibration
    from .decisions import (
        PlanSettings,
        ScenePlan,
        WorkPlan,
        plan_scene,
        plan_work,
        training_settings,
        work_plan_as_dict,
    )
    from .forecast import forecast_as_dict, forecast_work, require_enough_memory
    from .outcome import update_calibration
    from .plan_text import format_plan
    from .planned_work import plan_and_forecast, plan_photos, store_forecast

__all__ = [
    "Calibration",
    "PlanSettings",
    "ScenePlan",
    "WorkPlan",
    "calibrate",
    "forecast_as_dict",
    "forecast_work",
    "format_plan",
    "plan_and_forecast",
    "plan_photos",
    "plan_scene",
    "plan_work",
    "require_enough_memory",
    "store_forecast",
    "training_settings",
    "update_calibration",
    "work_plan_as_dict",
]

__getattr__ = lazy_exports(__name__, __file__)
