"""What a run really took, taken into the calibration for the next forecast."""

from __future__ import annotations

from collections.abc import Sequence

from ..project_folder import ProjectFolder
from ..training.settings import TrainingSettings
from .calibration import Calibration
from .decisions import WorkPlan
from .forecast import Forecast, training_cpu_seconds, wall_share

__all__ = ["learn_from"]


def learn_from(
    project: ProjectFolder,
    computed: Sequence[str],
    work: WorkPlan,
    training: TrainingSettings,
    forecast: Forecast,
    calibration: Calibration,
) -> None:
    """Compare the stages of this run with the formulas and store the calibration.

    Parameters
    ----------
    project : ProjectFolder
    computed : sequence of str
        Stages that this run computed; one that an earlier run had begun is passed over.
    work : WorkPlan
    training : TrainingSettings
    forecast : Forecast
        Made before the work.
    calibration : Calibration
        The one it was made with; changed and saved.

    Notes
    -----
    Where less was done than planned, the formula is asked about what was done: pairs are compared as planned, but a
    training that stopped early with the steps it took.
    """
    if work.preset == "test":
        return  # Seconds of start-up around nothing: no outcome to learn from.
    expected = {stage.stage: stage for stage in forecast.stages}
    learned = False
    for stage in computed:
        record = project.stage_record(stage)
        if record is None or record["continued"] or stage not in expected:
            continue
        formula = expected[stage].model_cpu_seconds
        figures = record["figures"]
        if stage == "training" and figures.get("stopped_early"):
            formula *= training_cpu_seconds(work, training, steps=figures["steps"]) / training_cpu_seconds(
                work, training
            )
        cpu, wall = record["cpu_seconds"], record["wall_seconds"]
        calibration.learn(stage, "cpu", formula=formula, actual=cpu)
        calibration.learn(stage, "wall", formula=cpu * wall_share(stage, forecast.cores), actual=wall)
        calibration.learn(stage, "memory", formula=expected[stage].model_memory, actual=record["peak_memory"])
        learned = True
    if learned:
        calibration.n_runs += 1
        calibration.save()
