"""An engine whose stages take no time, for the faults of a batch: real projects, locks, keys and events.

A worker uses it when it is started with ``--preload tests.engine.workers.batch.quick_engine``. Files in the photo
folder say what goes wrong: ``fail_STAGE`` holds a sentence, ``sleep_STAGE`` seconds, ``hold_STAGE`` lasts until it is
deleted; each stage that is computed adds a line to ``computed``, which no batch reads.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from engine.core import errors
from engine.core.events import Emit, StopCheck
from engine.pipeline.planning.forecast import Forecast, forecast_as_dict
from engine.pipeline.planning.stage_forecast import StageForecast
from engine.pipeline.runner import StageRunner
from engine.pipeline.stages import STAGES
from engine.project.folder import ProjectFolder, stage_key
from engine.workers.batch import helped_engine, stage_task

WITHOUT_MODELS = "TEST_WITHOUT_MODELS"
FULL_DISK = "TEST_FULL_DISK"
MEMORY = {"photos": 100_000_000, "cameras": 500_000_000, "training": 900_000_000, "report": 200_000_000}


def dask_setup(worker: object) -> None:
    """Called by Dask in a worker that preloads this module."""
    stage_task.MODULE = __name__


@contextlib.contextmanager
def _locked(photos: Path, out: Path) -> Iterator[ProjectFolder]:
    """Lock the project; where another engine works in it, the file `refused` says so."""
    with contextlib.ExitStack() as stack:
        try:
            project = stack.enter_context(ProjectFolder.create(out))
        except errors.ProjectInUse:
            (photos / "refused").touch()
            raise
        yield project


def reconstruct(
    photos: Path, out: Path, settings: Any, *, emit: Emit, should_stop: StopCheck, until: str
) -> ProjectFolder:
    """What the pipeline does, with empty stages."""
    with _locked(photos, out) as project:
        project.put("photo_folder", str(photos))
        runner = StageRunner(project, emit, should_stop)
        for stage in [stage for stage in STAGES[: STAGES.index(until) + 1] if stage in MEMORY]:
            output = out / stage / "result.txt"

            def compute(stage: str = stage, output: Path = output) -> dict[str, Any]:
                wait = photos / f"sleep_{stage}"
                while (photos / f"hold_{stage}").exists():
                    time.sleep(0.05)
                for _ in range(int(20 * float(wait.read_text()))) if wait.exists() else ():
                    time.sleep(0.05)
                    if should_stop():
                        raise errors.Cancelled("Stopped. Run the same command again to continue.")
                if (photos / f"fail_{stage}").exists():
                    raise errors.PhotoError((photos / f"fail_{stage}").read_text())
                if stage == "training" and os.environ.get(WITHOUT_MODELS):
                    raise errors.ModelFileError("The model mobile_sam is missing.")
                if stage == "cameras" and os.environ.get(FULL_DISK):
                    raise errors.DiskError("The disk is full.")
                runner.before_replacing_outputs(stage)
                output.parent.mkdir(exist_ok=True)
                output.write_text(f"{stage} of {(photos / 'photo.jpg').read_text()}")
                with (photos / "computed").open("a") as stream:
                    stream.write(f"{stage}\n")
                return {}

            runner.run(
                stage, stage_key(stage, (photos / "photo.jpg").read_text()), compute, {output: None}, settings={}
            )
            if stage == "photos":
                stages = tuple(
                    StageForecast(name, 1.0, 0.5, 2.0, 1.0, 1.0, most, most, most, most)
                    for name, most in MEMORY.items()
                )
                project.put("forecast", forecast_as_dict(Forecast(stages, None, 1, 0)))
        return project


if __name__ == "__main__":
    from engine.cli.commands import reconstruct as command

    command.reconstruct = reconstruct  # type: ignore[assignment]
    code = helped_engine.main()
    sys.stdout.flush()
    os._exit(code)
