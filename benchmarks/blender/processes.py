"""Blenders as Python modules, in processes of their own; see `inside`."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from ..places import ROOT, python_of


def run_inside(blender: str, *words: str | Path) -> dict[str, Any]:
    """Run a part of `inside` in a Blender and return its result."""
    command = [str(python_of(blender)), "-m", "benchmarks.blender.inside", *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr[-500:]}")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result
