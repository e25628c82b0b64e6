"""Workers killed at random moments while a batch runs: what it makes is compared with a batch that nobody disturbed."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from .photo_folders import same_scenes, write_folders
from .runs import ROOT, Cluster, batch_command, read_summary

_N_WORKERS = 2
_PAUSE = (1.0, 7.0)
"""Seconds between two kills: some fall into the start of the engine, most into a stage."""
_PRELOAD = "benchmarks.batch.short_engine"


def kills_table(folder: Path, n_folders: int, n_photos: int, n_kills: int, minutes: float, prompts: str = "") -> str:
    """Run batches until `n_kills` workers were killed or the minutes are over, and return the table.

    With `prompts`, the folders get masks and these objects too.
    """
    end = time.monotonic() + 60 * minutes
    photos = write_folders(folder / "scans", n_folders, n_photos)
    cluster = Cluster(folder / "cluster", _PRELOAD)
    cluster.start_scheduler()
    for _ in range(_N_WORKERS):
        cluster.start_worker()
    try:
        options = [f"--scheduler={cluster.address}", "--preset=test", "--tries=1000"]
        options.append(f"--prompts={prompts}" if prompts else "--no-objects")
        reference = folder / "reference"
        if subprocess.run(batch_command(photos, reference, *options), cwd=ROOT, stdout=subprocess.DEVNULL).returncode:
            raise RuntimeError(f"The batch without kills failed: {read_summary(reference)['folders']}")
        killed, runs, different, twice, restarts = 0, 0, Counter[str](), 0, 0
        stages = Counter[str]()
        failed: list[str] = []
        rng = random.Random(0)
        while killed < n_kills and time.monotonic() < end:
            out = folder / "scenes"
            process = subprocess.Popen(batch_command(photos, out, *options), cwd=ROOT, stdout=subprocess.DEVNULL)
            killed += _kill_while(process, cluster, rng, n_kills - killed)
            process.wait()
            runs += 1
            summary = read_summary(out)
            failed += [f"{one['name_']}: {one['error']}" for one in _named(summary) if one["state"] != "done"]
            twice += len(summary["twice"])
            restarts += sum(one["restarts"] for one in summary["folders"])
            for one in summary["folders"]:
                stages.update(note.split("'")[1] for note in one["notes"] if note.startswith("A worker was lost"))
            for scan in photos:
                if (out / scan.name / "report" / "report.html").is_file():
                    different.update(same_scenes(reference / scan.name, out / scan.name))
            print(f"{killed} kills in {runs} batches", file=sys.stderr, flush=True)
            shutil.rmtree(out)
    finally:
        cluster.stop()
    rows = [
        ("workers killed with SIGKILL", killed),
        ("batches that they fell into, each of " + f"{n_folders} folders", runs),
        ("tasks that another worker took over", restarts),
        (
            "folders and stages with such a loss",
            ", ".join(f"{name} {n}" for name, n in sorted(stages.items())) or "none",
        ),
        ("folders that were not done at the end", len(failed)),
        ("stages that were computed twice", twice),
        ("parts of scenes that differ from the batch without kills", dict(different) or "none: all bytes are equal"),
    ]
    table = "\n".join(["| what | count |", "| --- | --- |", *(f"| {what} | {value} |" for what, value in rows), ""])
    return table + "".join(f"- {one}\n" for one in failed)


def _named(summary: dict[str, list[dict[str, str]]]) -> list[dict[str, str]]:
    return [{**one, "name_": Path(one["out"]).name} for one in summary["folders"]]


def _kill_while(process: subprocess.Popen[bytes], cluster: Cluster, rng: random.Random, most: int) -> int:
    """Kill workers as long as a batch runs, one at a random moment each time; their nannies start them again."""
    killed = 0
    while killed < most:
        end = time.monotonic() + rng.uniform(*_PAUSE)
        while time.monotonic() < end:
            if process.poll() is not None:
                return killed
            time.sleep(0.05)
        workers = cluster.worker_processes()
        if workers:
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(workers), signal.SIGKILL)
                killed += 1
    return killed
