"""``doctor``: check what this machine has and lacks."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ...core.events import Emit, Finished, StopCheck
from ..doctor import examine

NAME = "doctor"
HELP = "Check what this machine has and lacks for the engine."
EXAMPLE = "python -m engine doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add no arguments."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Check the machine and print the results."""
    checks = examine()
    marks = {(True, True): "ok", (True, False): "ok", (False, True): "MISSING", (False, False): "without"}
    lines = [f"{marks[check.ok, check.required]:>8}  {check.name}: {check.detail}" for check in checks]
    outputs = {"checks": [asdict(check) for check in checks]}
    missing = [check.name for check in checks if check.required and not check.ok]
    if missing:
        lines.append(
            f"This machine lacks {', '.join(missing)}. Set up the engine again: in Blender, or with `make setup`."
        )
    emit(Finished("\n".join(lines), outputs))
    return 1 if missing else 0
