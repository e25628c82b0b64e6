"""The plan of a run: what the scene needs, what is left out and why, and the forecast of time and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .benchmark import calibrate
    from .calibration import Calibration
    from .decisions import (
        PlanSettings,
        ScenePlan,
        WorkPlan,
        choose_photos,
        plan_scene,
        plan_work,
        training_settings,
        work_plan_as_dict,
    )
    from .device_choice import choose_sizes, kept_sizes, planned_device, record_sizes, training_is_to_come
    from .forecast import forecast_as_dict, forecast_work
    from .memory_check import require_enough_memory
    from .outcome import update_calibration
    from .plan_text import format_plan, format_presets
    from .planned_work import PlannedWork, plan_and_forecast, plan_presets, store_forecast

__getattr__ = lazy_exports(__name__, __file__)
