"""The plan of a run: what the scene needs, what is left out and why, and the forecast of time and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .before_work import plan_and_forecast, plan_photos, store_forecast
    from .benchmark import calibrate
    from .calibration import Calibration
    from .decisions import PlanSettings, ScenePlan, WorkPlan, plan_scene, plan_work, training_settings
    from .forecast import as_dict, forecast_work, require_fit
    from .outcome import learn_from
    from .words import plan_in_words

__all__ = [
    "Calibration",
    "PlanSettings",
    "ScenePlan",
    "WorkPlan",
    "as_dict",
    "calibrate",
    "forecast_work",
    "learn_from",
    "plan_and_forecast",
    "plan_in_words",
    "plan_photos",
    "plan_scene",
    "plan_work",
    "require_fit",
    "store_forecast",
    "training_settings",
]

__getattr__ = lazy_exports(__name__, __file__)
