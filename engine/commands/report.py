"""``report``: write the report again from what the stages measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "report"
HELP = "Write the report of a scene: error against run time, stage times, objects, what was left out."
EXAMPLE = "python -m engine report scene"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")


def project_folder(options: argparse.Namespace) -> Path:
    """Return the project whose log is written."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write report.json and report.html."""
    from ..report import build_report

    with ProjectFolder.open_existing(options.project) as project:
        project.require_intact("cameras", "training")
        page = build_report(project)
        if project.stage_record("report") is not None:
            # The report is an output of that stage, which would take it for damaged.
            project.record_outputs("report", [page])
    emit(Finished(f"The report is {page}.", {"report": str(page)}))
    return 0
