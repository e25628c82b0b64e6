"""The path from photos to the report, taken apart."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.path import table
from benchmarks.processes import cpu_of_tree

RUN: dict[str, Any] = {
    "machine": "two cores",
    "device": "cpu",
    "photos": "demo/photos",
    "n_photos": 48,
    "preset": "standard",
    "n_objects": 8,
    "whole": [100.0, 200.0],
    "load": 1.0,
    "first_picture": {"stage": "cameras", "wall": 9.6, "cpu": 12.2},
    "parts": {
        "": [1.0, 1.0],
        "imports": [2.0, 2.0],
        "photos": [5.0, 5.0],
        "training": [4.0, 0.5],
        "training/steps": [70.0, 180.0],
        "training/imports": [3.0, 3.0],
        "training/writing": [0.1, 0.1],
    },
    "forecast": {"training": {"cpu_seconds": 91.8, "seconds": 154.2}},
    "stages": {"training": {"wall": 77.1, "cpu": 183.6}},
    "results": {"gaussians/scene.ply": "0123456789ab"},
}


def test_table_books_every_second_once_and_says_what_has_no_name() -> None:
    text = table(RUN)
    assert "| **training** |  | 77.1 | 77.1 % | 183.6 | 91.8 % |" in text
    assert "|  | steps | 70.0 | 70.0 % | 180.0 | 90.0 % |" in text
    assert "|  | what has no name | 4.0 | 4.0 % | 0.5 | 0.2 % |" in text
    # What the process took outside of all parts, and all imports together.
    assert "|  | start and end of the process | 14.9 | 14.9 % | 8.4 | 4.2 % |" in text
    assert "| imports | 5.0 | 5.0 % | 5.0 | 2.5 % |" in text
    assert "|  | writing |" not in text and "| writing | 0.1 | 0.1 % |" in text
    assert "No name: 10.0 % of the wall" in text


def test_table_compares_each_stage_with_its_forecast() -> None:
    assert "| training | 91.8 | 183.6 | 2.00 | 154.2 | 77.1 | 0.50 |" in table(RUN)


def test_table_says_when_the_scene_was_seen_first() -> None:
    assert "First picture of the scene after 10 s and 12 CPU s, in the stage cameras." in table(RUN)
    assert "No picture." in table({**RUN, "first_picture": None})


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="only Linux tells the CPU seconds of other processes")
def test_cpu_seconds_at_the_first_picture_count_child_processes() -> None:
    code = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\ninput()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None and child.stdin is not None
        child.stdout.readline()
        # A tick of the system's clock less.
        assert cpu_of_tree(child.pid) >= 0.28
        assert cpu_of_tree(os.getpid()) >= cpu_of_tree(child.pid)
        child.stdin.close()
