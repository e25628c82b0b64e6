"""Refusal of work for which there is too little memory, with the presets that fit."""

from __future__ import annotations

import math
from dataclasses import replace

from ...core.errors import EnvironmentProblem
from ...training import settings_with_sizes, sizes_on_card
from ...training.settings import OFFERED_PRESETS
from .calibration import Calibration, outcome_name
from .decisions import WorkPlan
from .forecast import Forecast, memory_of


def require_enough_memory(forecast: Forecast, work: WorkPlan, calibration: Calibration) -> None:
    """Raise an error if a stage needs more memory than is free.

    Raises
    ------
    EnvironmentProblem
        When a stage is expected to need more memory than is free. The message states both and the presets that fit.
    """
    free, largest = forecast.free_memory, forecast.largest
    if free is None or largest.memory <= free:
        return
    size = f"{work.max_gaussians:,} Gaussians, {work.n_photos} photos of {work.width} x {work.height} pixels"
    fitting = _presets_that_fit(work, forecast.cores, calibration, free)
    if fitting:
        change = "Choose " + " or ".join(f"--preset {name} (needs {_gb(need)})" for name, need in fitting)
        change += ", or close other programs."
    else:
        change = "No preset fits: close other programs, use fewer photos, or use a machine with more memory."
    raise EnvironmentProblem(
        f"The preset {work.preset} needs about {_gb(largest.memory)} of memory for {largest.stage} ({size}), and "
        f"{_gb(free)} are free. {change}"
    )


def _presets_that_fit(work: WorkPlan, cores: int, calibration: Calibration, free: int) -> list[tuple[str, int]]:
    """Return the smaller presets that fit into `free` bytes, the largest first, with the bytes that each needs."""
    fitting = []
    for name in [preset.name for preset in reversed(OFFERED_PRESETS)]:
        on_card = sizes_on_card(name, 0, n_training=work.n_training) if work.device.backend == "gpu" else {}
        preset = settings_with_sizes(name, on_card, work.n_training)
        scale = min(1.0, preset.schedule.max_side / max(work.photo_width, work.photo_height))
        smaller = replace(
            work, preset=name, max_gaussians=preset.growth.max_gaussians, sh_degree=preset.appearance.sh_degree,
            steps=preset.schedule.steps,
            width=round(work.photo_width * scale), height=round(work.photo_height * scale),
        )  # fmt: skip
        stages = ["photos", "cameras", "training"] + (["masks"] if work.n_mask_photos else [])
        need = max(
            int(
                memory_of(stage, smaller, preset, cores=cores, libraries=calibration.extra_library_memory, free=free)
                * math.exp(calibration.correction(outcome_name(stage, work.device.name), "memory").mean)
            )
            for stage in stages
        )
        if need <= free and name != work.preset and preset.growth.max_gaussians < work.max_gaussians:
            fitting.append((name, need))
    return fitting


def _gb(value: int) -> str:
    return f"{value / 1e9:.1f} GB"
