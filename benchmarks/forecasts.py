"""Forecasts beside what the work took: ``python -m benchmarks.forecasts PROJECT... [--out FILE.md]``.

Each PROJECT was made by `reconstruct` without interruption. For a fair table name an empty calibration beforehand
(``GAUSSIAN_HERITAGE_CALIBRATION``, another file for each): otherwise earlier runs on this machine have corrected it.

example: python -m benchmarks.forecasts statue/project banana/project --out docs/forecasts.md
"""

from __future__ import annotations

import argparse
import platform
from pathlib import Path
from typing import Any

from engine.machine import describe_machine
from engine.project_folder import ProjectFolder, atomic_write

_HEAD = """| photo set | stage | forecast s | took s | took / forecast | forecast MB | took MB | took / forecast |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"""
_GOALS = """Goals: time of a whole run within 30 %, its memory (of the largest stage) within 25 %.
Training is compared with a forecast of all its steps, also where its curve was flat before the last one."""


def rows(project: ProjectFolder) -> list[str]:
    """Return a table row for each stage of a project, and one for the whole."""
    forecast: dict[str, Any] = project.get("forecast")
    name = Path(str(project.get("photo_folder"))).parent.name
    lines, seconds, memory = [], [], []
    for stage in forecast["stages"]:
        record = project.stage_record(stage["stage"])
        if record is None or record["continued"]:
            raise SystemExit(f"{project.path} was interrupted in its stage {stage['stage']}: make it anew.")
        seconds.append((stage["seconds"], record["wall_seconds"]))
        memory.append((stage["memory"], record["peak_memory"]))
        lines.append(_row(name, stage["stage"], seconds[-1], memory[-1]))
    whole = sum(expected for expected, _ in seconds), sum(took for _, took in seconds)
    lines.append(_row(f"**{name}**", "**whole**", whole, (max(m for m, _ in memory), max(m for _, m in memory))))
    return lines


def _row(name: str, stage: str, seconds: tuple[float, float], memory: tuple[float, float]) -> str:
    (expected, took), (foreseen, held) = seconds, memory
    return (
        f"| {name} | {stage} | {expected:,.1f} | {took:,.1f} | {took / expected:.2f} "
        f"| {foreseen / 1e6:,.0f} | {held / 1e6:,.0f} | {held / foreseen:.2f} |"
    )


def main() -> None:
    """Print the table, and write it when asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("projects", type=Path, nargs="+", help="project folders")
    parser.add_argument("--out", type=Path, help="file for the table")
    options = parser.parse_args()
    projects = [ProjectFolder.open_existing(path) for path in options.projects]
    table = "\n".join([_HEAD, *(line for project in projects for line in rows(project))])
    cores = describe_machine().cores
    text = (
        "# Forecasts beside what the work took\n\n```\npython -m benchmarks.forecasts PROJECT... --out FILE.md\n```\n\n"
        f"{table}\n\n{_GOALS}\n\n{cores} cores, {platform.system()} {platform.machine()}.\n"
    )
    print(text)
    if options.out:
        with atomic_write(options.out) as file:
            file.write(text.encode())


if __name__ == "__main__":
    main()
