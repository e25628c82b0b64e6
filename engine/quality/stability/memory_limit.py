"""Training with limited memory, in a process of its own: ``python -m engine.quality.stability.memory_limit FOLDER``.

It prints one JSON object: type, message and exit code of the error, the step of the last checkpoint, and whether the
run, resumed without the limit, gives the Gaussians of an uninterrupted run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from ...core.errors import HeritageError
from ...core.system import limit_memory
from ...training import read_progress
from .training_measure import non_finite_values, run_training, same_gaussians
from .training_scenes import SETTINGS, known_capture, training_input

MALLOC_ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}
"""Settings of the GNU C library with which large arrays are requested from the system each time, so that a limit on the
process acts at once."""

_LAST_STEP_WITHOUT_LIMIT = 45
_GROWING_SETTINGS = SETTINGS.changed(steps=70, growth_strategy="opacity", grow_factor=2.0, max_gaussians=20_000)
"""The number of Gaussians doubles every 10 steps, from 400 to 20,000. The limit is reached at 6,400."""


def main(folder: Path) -> None:
    """Train without the limit, train with it, and resume without it."""
    inputs = training_input(known_capture()[0], SETTINGS)
    uninterrupted = run_training(inputs, _GROWING_SETTINGS, folder / "uninterrupted", lambda: False)
    steps = iter(range(10**6))
    remove_limit: list[Callable[[], None]] = []

    def limit_and_continue() -> bool:
        if next(steps) == _LAST_STEP_WITHOUT_LIMIT:
            lift = limit_memory(0)
            if lift is None:
                # This system has no such limit.
                raise MemoryError
            remove_limit.append(lift)
        return False

    answer: dict[str, object] = {"type": None, "message": "", "code": 0}
    try:
        run_training(inputs, _GROWING_SETTINGS, folder / "limited", limit_and_continue)
    except HeritageError as error:
        answer = {"type": type(error).__name__, "message": str(error), "code": error.exit_code}
    finally:
        for call in remove_limit:
            call()
    answer["step"] = (read_progress(folder / "limited") or {"step": 0})["step"]
    answer["problems"] = non_finite_values(folder / "limited")
    resumed = run_training(inputs, _GROWING_SETTINGS, folder / "limited", lambda: False)
    answer["same"] = same_gaussians(uninterrupted.gaussians, resumed.gaussians)
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
