"""Training that runs out of memory on purpose, in a process of its own: ``python -m engine.stability.starved FOLDER``.

Prints one JSON object: the error's type, sentence and exit code, the step of the checkpoint that is left, and whether
the same run, continued with memory again, gives the Gaussians of a run that was never short of it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ..errors import HeritageError
from ..training import read_progress
from .training_measure import problems_of_files, same_gaussians, trained
from .training_scenes import SETTINGS, known_capture, training_input

__all__ = ["ENVIRONMENT", "take_memory_away"]

ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}
"""For the GNU C library: large arrays come from the system each time, so a limit on the process is felt at once."""

_LAST_STEP_WITH_MEMORY = 45
_GROWING = replace(SETTINGS, steps=70, growth="opacity", grow_factor=2.0, max_gaussians=20_000)
"""Doubles every 10 steps, from 400 to 20,000 Gaussians; the memory that is left is that of 6,400."""


def take_memory_away() -> Callable[[], None]:
    """Forbid this process to grow, and return what allows it again."""
    if sys.platform != "linux":
        # Elsewhere a limit on a process does not exist or is not kept.
        raise MemoryError
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize(), before[1]))
    return lambda: resource.setrlimit(resource.RLIMIT_AS, before)


def main(folder: Path) -> None:
    """Train with enough memory, with too little, and go on with enough again."""
    given = training_input(known_capture()[0], SETTINGS)
    whole = trained(given, _GROWING, folder / "whole", lambda: False)
    steps = iter(range(10**6))
    give_back: list[Callable[[], None]] = []

    def starve() -> bool:
        if next(steps) == _LAST_STEP_WITH_MEMORY:
            give_back.append(take_memory_away())
        return False

    answer: dict[str, object] = {"type": None, "sentence": "", "code": 0}
    try:
        trained(given, _GROWING, folder / "starved", starve)
    except HeritageError as error:
        answer = {"type": type(error).__name__, "sentence": str(error), "code": error.exit_code}
    finally:
        for call in give_back:
            call()
    answer["step"] = (read_progress(folder / "starved") or {"step": 0})["step"]
    answer["problems"] = problems_of_files(folder / "starved")
    continued = trained(given, _GROWING, folder / "starved", lambda: False)
    answer["same"] = same_gaussians(whole.gaussians, continued.gaussians)
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
