"""A command on the workers of a cluster says and does what it would here; the server's queue uses it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.batch.runs import ROOT, Cluster
from engine.core import errors
from engine.core.events import Event, Finished, Progress, StageFinished, Warned, never_stop
from engine.workers.batch import BatchSettings, run_remote_job
from tests.conftest import PATIENCE
from tests.engine.workers.batch.conftest import MakeFolders
from tests.engine.workers.batch.quick_engine import MEMORY

STAGES = list(MEMORY)


@pytest.fixture(scope="module")
def one_worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and a worker, for tests that kill neither."""
    made = Cluster(tmp_path_factory.mktemp("one worker"), preload="tests.engine.workers.batch.quick_engine")
    made.start_scheduler()
    made.start_worker(nanny=False)
    yield made
    made.stop()


def run(
    cluster: Cluster, command: list[str], out: Path, should_stop: Callable[[], bool] = never_stop, **settings: Any
) -> list[Event]:
    said: list[Event] = []
    chosen = BatchSettings(out=out.parent, scheduler=cluster.address, **{"busy_pause": 0.3, **settings})
    run_remote_job(command, out, chosen, emit=said.append, should_stop=should_stop)
    return said


def computed(folder: Path) -> list[str]:
    return (folder / "computed").read_text().split()


def test_reconstruction_reports_each_stage_once_as_it_would_here(
    one_worker: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    (photos,) = make_folders(1)
    out = tmp_path / "scene"
    said = run(one_worker, ["reconstruct", str(photos), f"--out={out}", "--preset=preview"], out)
    assert computed(photos) == STAGES
    assert [event.stage for event in said if isinstance(event, StageFinished)] == STAGES
    assert isinstance(said[-1], Finished) and said[-1].outputs
    again = run(one_worker, ["reconstruct", str(photos), f"--out={out}", "--preset=preview"], out)
    assert computed(photos) == STAGES and isinstance(again[-1], Finished)


def test_error_of_the_engine_on_the_worker_is_raised_here(
    one_worker: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    (photos,) = make_folders(1, fail_cameras="The photos do not overlap.")
    out = tmp_path / "scene"
    with pytest.raises(errors.PhotoError, match="^The photos do not overlap.$"):
        run(one_worker, ["reconstruct", str(photos), f"--out={out}"], out)
    with pytest.raises(errors.ProjectError, match="is not a Gaussian Heritage project"):
        run(one_worker, ["segment", str(tmp_path), "--prompt=vase"], tmp_path / "nothing here")
    with pytest.raises(errors.HeritageError, match="walk.mp4"):
        run(one_worker, ["frames", str(tmp_path / "walk.mp4"), f"--out={photos}"], photos)


def test_job_whose_worker_is_killed_is_done_by_another(
    cluster: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    cluster.start_worker(nanny=True)
    (photos,) = make_folders(1, sleep_training="2")
    out = tmp_path / "scene"
    killed: list[int] = []

    def kill_in_training() -> bool:
        file = out / "project.json"
        if not killed and file.exists() and (json.loads(file.read_text()).get("begun") or [""])[0] == "training":
            killed.extend(cluster.worker_processes())
            os.kill(killed[0], signal.SIGKILL)
        return False

    said = run(cluster, ["reconstruct", str(photos), f"--out={out}"], out, kill_in_training)
    assert killed and computed(photos) == STAGES
    assert [event.message for event in said if isinstance(event, Warned)] == [
        "A worker was lost in the stage 'training'; another one went on with it."
    ]


def test_job_that_is_stopped_here_stops_on_its_worker(
    one_worker: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    (photos,) = make_folders(1, sleep_cameras=str(PATIENCE))
    out = tmp_path / "scene"

    def once_it_runs() -> bool:
        return (photos / "computed").exists() and computed(photos) == ["photos"]

    with pytest.raises(errors.Cancelled):
        run(one_worker, ["reconstruct", str(photos), f"--out={out}"], out, once_it_runs)
    assert computed(photos) == ["photos"]


def test_job_waits_for_a_worker_and_says_so_then_that_there_is_none(cluster: Cluster, tmp_path: Path) -> None:
    said: list[Event] = []
    settings = BatchSettings(out=tmp_path, scheduler=cluster.address, worker_wait=1.0)
    with pytest.raises(errors.HeritageError, match="No worker is connected to the scheduler"):
        run_remote_job(
            ["reconstruct", str(tmp_path), f"--out={tmp_path / 'scene'}"],
            tmp_path / "scene", settings, emit=said.append, should_stop=never_stop,
        )  # fmt: skip
    assert [event.message for event in said if isinstance(event, Progress)] == ["waiting for a free worker"]


def test_command_that_no_worker_may_run_is_refused_by_a_sentence() -> None:
    words = ["remote", "--scheduler=tcp://127.0.0.1:1", "--", "trash", "scene"]
    done = subprocess.run([sys.executable, "-m", "engine", *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode != 0 and "'trash' is none of them" in done.stderr + done.stdout
