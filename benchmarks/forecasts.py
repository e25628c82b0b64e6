"""Comparison of forecasts with measured runs: ``python -m benchmarks.forecasts PROJECT... [--out FILE.md]``.

Each PROJECT must have been made by `reconstruct` without interruption. For a fair table, give each run an empty
calibration (``GAUSSIAN_HERITAGE_CALIBRATION`` with a new file); otherwise earlier runs on this machine correct it.

example: python -m benchmarks.forecasts statue/project banana/project --out docs/forecasts.md
"""

from __future__ import annotations

import argparse
import platform
from pathlib import Path
from typing import Any

from engine.core.files import atomic_write
from engine.core.system import describe_machine
from engine.project.folder import ProjectFolder

_HEAD = (
    "| photo set | stage | forecast s | measured s | measured / forecast "
    "| forecast MB | measured MB | measured / forecast |\n"
    "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"
)
_GOALS = "Goals: the time of a whole run within 30 %, its memory (that of the largest stage) within 25 %."


def rows(project: ProjectFolder) -> list[str]:
    """Return a table row for each stage of a project, and one for the whole."""
    forecast: dict[str, Any] = project.get("forecast")
    name = Path(str(project.get("photo_folder"))).parent.name
    lines, seconds, memory = [], [], []
    for stage in forecast["stages"]:
        record = project.stage_record(stage["stage"])
        if record is None or record["continued"]:
            raise SystemExit(f"{project.path} was interrupted in its stage {stage['stage']}: make it again.")
        seconds.append((stage["seconds"], record["wall_seconds"]))
        memory.append((stage["memory"], record["peak_memory"]))
        lines.append(_row(name, stage["stage"], seconds[-1], memory[-1]))
    whole = sum(expected for expected, _ in seconds), sum(measured for _, measured in seconds)
    lines.append(_row(f"**{name}**", "**whole**", whole, (max(m for m, _ in memory), max(m for _, m in memory))))
    return lines


def _row(name: str, stage: str, time: tuple[float, float], memory: tuple[float, float]) -> str:
    (forecast_seconds, seconds), (forecast_bytes, used_bytes) = time, memory
    return (
        f"| {name} | {stage} | {forecast_seconds:,.1f} | {seconds:,.1f} | {seconds / forecast_seconds:.2f} "
        f"| {forecast_bytes / 1e6:,.0f} | {used_bytes / 1e6:,.0f} | {used_bytes / forecast_bytes:.2f} |"
    )


def main() -> None:
    """Print the table, and write it to the file given by ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("projects", type=Path, nargs="+", help="project folders")
    parser.add_argument("--out", type=Path, help="file for the table")
    options = parser.parse_args()
    projects = [ProjectFolder.open_existing(path) for path in options.projects]
    table = "\n".join([_HEAD, *(line for project in projects for line in rows(project))])
    cores = describe_machine().cores
    text = (
        "# Forecasts compared with measured runs\n\n"
        "```\npython -m benchmarks.forecasts PROJECT... --out FILE.md\n```\n\n"
        f"{table}\n\n{_GOALS}\n\n{cores} cores, {platform.system()} {platform.machine()}.\n"
    )
    print(text)
    if options.out:
        with atomic_write(options.out) as file:
            file.write(text.encode())


if __name__ == "__main__":
    main()
