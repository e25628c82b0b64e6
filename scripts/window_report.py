"""What the window test has measured, from the logs of its harness."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

MAX_WHILE_WORKING, MAX_WHILE_ARRIVING = 0.1, 0.3
"""Goals in CPU seconds of a call of the add-on while a job runs, and while its result arrives."""
IMPORTERS = ("_poll_job", "HERITAGE_OT_open_project.execute")
"""Functions that import results."""


def read_log(work: Path, kind: str) -> list[dict[str, float]]:
    """Return the entries of a log of the harness."""
    file = work / f"{kind}.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def longest_calls(work: Path) -> dict[str, tuple[float, float, float]]:
    """Return the seconds of the longest calls of each function of the add-on, the longest first.

    CPU seconds, CPU seconds without those of Blender's own tools, and wall seconds; each of the call where it is most.
    """
    longest: dict[str, tuple[float, float, float]] = defaultdict(lambda: (0.0, 0.0, 0.0))
    for entry in read_log(work, "calls"):
        cpu, own, wall = longest[str(entry["name"])]
        here = entry["cpu"] - entry["blender"]
        longest[str(entry["name"])] = max(cpu, entry["cpu"]), max(own, here), max(wall, entry["seconds"])
    return dict(sorted(longest.items(), key=lambda item: item[1], reverse=True))


def report(work: Path, set_up_seconds: float, load: float) -> str:
    """Return the measurements as a section of docs/window.md; `load` is the number of programs that wanted a core."""
    gaps = sorted((entry["seconds"] for entry in read_log(work, "gaps")), reverse=True)
    lines = [
        "```\nmake window-test\n```", "",
        f"Set-up from the offline bundle: {set_up_seconds:.0f} s, by three presses: install, set up, confirm.", "",
        f"Programs that wanted a core at the end: {load:.0f}. Seconds besides CPU seconds depend on it.", "",
        "| longest calls of the add-on | CPU seconds | of these its own | seconds |", "| --- | ---: | ---: | ---: |",
    ]  # fmt: skip
    lines += [
        f"| `{name}` | {cpu:.3f} | {own:.3f} | {wall:.3f} |"
        for name, (cpu, own, wall) in list(longest_calls(work).items())[:8]
    ]
    lines += [
        "",
        "`ViewTool.modal` calls Blender's own *Select Box* and *Select Lasso*, which compile its shaders when they are "
        "used first. They are left out of its own seconds.",
        "",
        f"Above the goals: {'; '.join(calls_above_goals(work)) or 'none'}.",
        "",
        f"Gaps of the event loop above 0.3 s: {len(gaps)}, the longest {max(gaps, default=0.0):.1f} s. They are "
        "Blender's own redraws of the scene in software OpenGL, and the compilation of its shaders.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def calls_above_goals(work: Path) -> list[str]:
    """Return the calls of the add-on that held up the window. No failure: on a busy computer CPU seconds grow, too."""
    return [
        f"`{name}` took {own:.2f} CPU s of its own, more than {goal} s"
        for name, (_, own, _) in longest_calls(work).items()
        if own > (goal := MAX_WHILE_ARRIVING if name in IMPORTERS else MAX_WHILE_WORKING)
    ]
