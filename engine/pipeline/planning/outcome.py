"""Update of the calibration with the time and memory that a run took."""

from __future__ import annotations

from collections.abc import Sequence

from ...project.folder import ProjectFolder
from .calibration import Calibration, outcome_name
from .decisions import WorkPlan
from .forecast import Forecast


def update_calibration(
    project: ProjectFolder,
    computed: Sequence[str],
    work: WorkPlan,
    forecast: Forecast,
    calibration: Calibration,
) -> None:
    """Compare the stages of this run with the formulas, and correct and save the calibration.

    Parameters
    ----------
    computed : sequence of str
        Stages that this run computed. Stages that an earlier run had begun are skipped.
    forecast : Forecast
        Made before the work.
    calibration : Calibration
        The one that the forecast was made with. It is changed and saved.

    Notes
    -----
    The number of matched pairs is taken from the plan. Of masks that were made beside the cameras, the CPU time and the
    memory are compared: their wall time is that of both stages.
    """
    if work.preset == "test":
        return  # Its seconds are start-up time, which says nothing about the formulas.
    expected = {stage.stage: stage for stage in forecast.stages}
    updated = False
    for stage in computed:
        record = project.stage_record(stage)
        if record is None or record["continued"] or stage not in expected:
            continue
        if stage == "training" and record["figures"].get("device", "cpu") != forecast.device:
            continue  # The plan expected that it would be reused.
        beside = record["figures"].get("beside")
        if beside is not None and beside["n_kept"]:
            continue
        formula = expected[stage].model_cpu_seconds
        cpu, wall = record["cpu_seconds"], record["wall_seconds"]
        outcome = outcome_name(stage, forecast.device)
        calibration.add_outcome(outcome, "cpu", formula=formula, actual=cpu)
        peak = record["peak_memory"]
        if beside is None:
            calibration.add_outcome(outcome, "wall", formula=cpu * expected[stage].wall_share, actual=wall)
        elif beside["peak_memory"] is not None:
            peak = max(beside["peak_memory"], peak or 0)
        calibration.add_outcome(outcome, "memory", formula=expected[stage].model_memory, actual=peak)
        updated = True
    if updated:
        calibration.n_runs += 1
        calibration.save()
