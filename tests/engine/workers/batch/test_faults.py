"""Whatever happens to workers and scheduler: no folder is lost, no stage done twice, and the summary says it.

Schedulers, workers, projects, locks and child processes are real; the stages themselves take no time.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from distributed import Client

from benchmarks.batch.runs import Cluster, batch_command, read_summary
from engine.core.events import Event, Warned, ignore_events, never_stop
from engine.project.folder import ProjectFolder
from engine.workers.batch import BatchResult, BatchSettings, run_batch, summary_as_dict, summary_text
from tests.conftest import PATIENCE, wait_until
from tests.engine.workers.batch.conftest import MakeFolders
from tests.engine.workers.batch.quick_engine import FULL_DISK, MEMORY, WITHOUT_MODELS

STAGES = list(MEMORY)


def run(cluster: Cluster, folders: Sequence[Path], out: Path, **settings: Any) -> BatchResult:
    chosen = BatchSettings(out=out, scheduler=cluster.address, **{"busy_pause": 0.3, **settings})
    return run_batch(folders, chosen, emit=ignore_events, should_stop=never_stop)


def computed(folder: Path) -> list[str]:
    """What was computed of a folder by all batches."""
    file = folder / "computed"
    return file.read_text().split() if file.exists() else []


def begun(project: Path) -> str:
    """The stage that was begun last."""
    stage: str = (json.loads(project.read_text()).get("begun") or [""])[0]
    return stage


def in_background(work: Callable[[], BatchResult]) -> tuple[threading.Thread, list[BatchResult]]:
    results: list[BatchResult] = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    return thread, results


@pytest.mark.faults
def test_one_that_fails_among_ten_does_not_stop_the_others(
    cluster: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    cluster.start_worker(nanny=False)
    cluster.start_worker(nanny=False)
    folders = make_folders(10)
    (folders[3] / "fail_cameras").write_text("The photos do not overlap.")
    result = run(cluster, folders, tmp_path / "scenes")
    assert not result.succeeded
    assert [one.name for one in result.folders if one.state == "failed"] == ["scan_3"]
    assert [computed(folder) for folder in folders] == [["photos"] if i == 3 else STAGES for i in range(10)]
    text = summary_text(result.folders, result.notes)
    assert "9 of 10 folders are done, 1 failed." in text
    assert "scan_3: failed: The photos do not overlap." in text
    # Run again, only what failed is done.
    (folders[3] / "fail_cameras").unlink()
    again = run(cluster, folders, tmp_path / "scenes")
    assert again.succeeded
    assert [one.computed for one in again.folders] == [STAGES[1:] if i == 3 else [] for i in range(10)]
    assert [computed(folder) for folder in folders] == [STAGES] * 10


@pytest.mark.parametrize(
    "stage", [one if one == "training" else pytest.param(one, marks=pytest.mark.faults) for one in STAGES]
)
def test_worker_killed_in_a_stage(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path, stage: str) -> None:
    first = cluster.start_worker(nanny=False)
    (folder,) = make_folders(1, **{f"sleep_{stage}": "3"})
    thread, results = in_background(lambda: run(cluster, [folder], tmp_path / "scenes"))
    project = tmp_path / "scenes" / "scan_0" / "project.json"
    wait_until(lambda: project.exists() and (stage == "photos" or begun(project) == stage))
    first.kill()
    cluster.start_worker(nanny=False)
    thread.join(PATIENCE)
    assert results[0].succeeded
    # The engine of the killed worker is gone: it would hold the lock, and finish the stage a second time.
    assert computed(folder) == STAGES
    (state,) = results[0].folders
    assert state.restarts >= 1
    assert f"A worker was lost in the stage {stage!r}" in summary_text(results[0].folders, results[0].notes)
    assert summary_as_dict(results[0].folders, results[0].notes, 1.0)["twice"] == []


@pytest.mark.faults
def test_scheduler_started_again(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False)
    folders = make_folders(2, sleep_cameras="3")
    thread, results = in_background(lambda: run(cluster, folders, tmp_path / "scenes"))
    wait_until(lambda: "photos" in computed(folders[0]))
    assert cluster.scheduler is not None
    cluster.scheduler.kill()
    cluster.scheduler.wait()
    cluster.start_scheduler()
    # As a service manager does: a worker ends with its scheduler.
    cluster.start_worker(nanny=False)
    thread.join(PATIENCE)
    assert results[0].succeeded
    assert [computed(folder) for folder in folders] == [STAGES] * 2
    assert "The scheduler was lost" in " ".join(results[0].notes)


@pytest.mark.faults
def test_worker_without_models_is_avoided(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False, environment={WITHOUT_MODELS: "1"})
    folders = make_folders(3)
    thread, results = in_background(lambda: run(cluster, folders, tmp_path / "scenes", tries=50))
    wait_until(lambda: "cameras" in computed(folders[0]))
    cluster.start_worker(nanny=False)
    thread.join(PATIENCE)
    assert results[0].succeeded
    assert [computed(folder) for folder in folders] == [STAGES] * 3
    assert "The model mobile_sam is missing." in " ".join(results[0].notes)


@pytest.mark.faults
def test_full_disk_on_one_worker(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False, environment={FULL_DISK: "1"})
    (folder,) = make_folders(1)
    failed = run(cluster, [folder], tmp_path / "scenes", tries=2)
    assert failed.folders[0].error == "The disk is full."
    cluster.start_worker(nanny=False)
    result = run(cluster, [folder], tmp_path / "scenes", tries=50)
    assert result.succeeded
    assert computed(folder) == STAGES


def test_two_batches_on_the_same_folders(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False)
    cluster.start_worker(nanny=False)
    (folder,) = make_folders(1, hold_cameras="")
    thread, others = in_background(lambda: run(cluster, [folder], tmp_path / "scenes"))
    wait_until(lambda: "photos" in computed(folder) and begun(tmp_path / "scenes/scan_0/project.json") == "cameras")
    second, results = in_background(lambda: run(cluster, [folder], tmp_path / "scenes"))
    wait_until((folder / "refused").exists)
    (folder / "hold_cameras").unlink()
    for each in (thread, second):
        each.join(PATIENCE)
    (result,) = results
    assert result.succeeded and others[0].succeeded
    assert sorted(computed(folder)) == sorted(STAGES)
    said = summary_text(result.folders, ()) + summary_text(others[0].folders, ())
    assert "Another job worked in the project; this batch waited for it and kept what it did." in said


@pytest.mark.faults
def test_stage_that_no_worker_can_do_is_said(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False)
    # On a busy computer it starts for longer than the batch waits, which then says that there is no worker.
    with Client(cluster.address, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=PATIENCE)
    (folder,) = make_folders(1)
    result = run(cluster, [folder], tmp_path / "scenes", photos_memory=100_000_000_000, worker_wait=1.0)
    assert "'photos' needs 100.0 GB of memory, and the largest worker has 6.0 GB" in result.folders[0].error


@pytest.mark.faults
def test_large_stages_never_share_a_worker(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    """A worker of two threads and 6 GB does two small stages at a time, and two of 4 GB one after the other."""
    cluster.start_worker(nanny=False, threads=2)
    folders = make_folders(2, sleep_photos="1")
    for memory, most in ((1_000_000_000, 2), (4_000_000_000, 1)):
        out = tmp_path / f"scenes_{memory}"
        thread, results = in_background(lambda out=out, memory=memory: run(cluster, folders, out, photos_memory=memory))
        together = 0
        while thread.is_alive():
            begun = [out / folder.name / "project.json" for folder in folders]
            open_now = sum(file.exists() and '"photos"' not in file.read_text() for file in begun)
            together = max(together, open_now)
            time.sleep(0.02)
        assert results[0].succeeded
        assert together == most


@pytest.mark.faults
def test_shipped_photos_and_results(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False)
    (folder,) = make_folders(1)
    out = tmp_path / "scenes"
    assert run(cluster, [folder], out, ship=True).succeeded
    # The workers had the photo alone, and computed beside it.
    assert computed(folder) == []
    assert (out / "scan_0" / "training" / "result.txt").read_text() == "training of scan_0"
    assert ProjectFolder.open_existing(out / "scan_0").get("photo_folder") == str(folder)
    again = run(cluster, [folder], out, ship=True)
    assert again.succeeded and again.folders[0].computed == []


@pytest.mark.faults
def test_interrupted_batch_stops_its_engines_and_continues(
    cluster: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    cluster.start_worker(nanny=False)
    folders = make_folders(2, sleep_cameras=str(PATIENCE))
    out = tmp_path / "scenes"
    process = subprocess.Popen(batch_command(folders, out, f"--scheduler={cluster.address}"), stdout=subprocess.PIPE)
    wait_until(lambda: "photos" in computed(folders[0]) and begun(out / "scan_0" / "project.json") == "cameras")
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert [one["state"] for one in read_summary(out)["folders"]] == ["stopped", "stopped"]
    # Nothing of it runs any more: the projects can be locked.
    for name in ("scan_0", "scan_1"):
        if (out / name / "project.json").exists():
            with ProjectFolder.open_existing(out / name):
                pass
    for folder in folders:
        (folder / "sleep_cameras").unlink()
    assert run(cluster, folders, out).succeeded
    assert [computed(folder) for folder in folders] == [STAGES] * 2


@pytest.mark.faults
def test_faults_are_said_while_the_batch_runs(cluster: Cluster, make_folders: MakeFolders, tmp_path: Path) -> None:
    cluster.start_worker(nanny=False)
    (folder,) = make_folders(1, fail_training="No photo is sharp.")
    events: list[Event] = []
    settings = BatchSettings(out=tmp_path / "scenes", scheduler=cluster.address)
    run_batch([folder], settings, emit=events.append, should_stop=never_stop)
    assert [event.message for event in events if isinstance(event, Warned)] == ["scan_0 failed: No photo is sharp."]


@pytest.mark.faults
def test_engine_killed_for_memory_does_not_take_the_worker_along(
    cluster: Cluster, make_folders: MakeFolders, tmp_path: Path
) -> None:
    worker = cluster.start_worker(nanny=False)
    (folder,) = make_folders(1, sleep_cameras="3")
    thread, results = in_background(lambda: run(cluster, [folder], tmp_path / "scenes"))
    wait_until(lambda: "photos" in computed(folder) and bool(children_of(worker.pid)))
    wait_until(lambda: begun(tmp_path / "scenes" / "scan_0" / "project.json") == "cameras")
    for child in children_of(worker.pid):
        os.kill(child, signal.SIGKILL)
    thread.join(PATIENCE)
    assert worker.poll() is None
    assert results[0].succeeded
    assert computed(folder) == STAGES
    assert "is tried with" in summary_text(results[0].folders, ())


def children_of(process: int) -> list[int]:
    found = Path(f"/proc/{process}/task").glob("*/children")
    return [int(word) for file in found for word in file.read_text().split()]
