"""``report``: write the report again from what the stages measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder
from .scene_options import add_device_option

NAME = "report"
HELP = "Write the report of a scene in each language: error against run time, stage times, objects, what was left out."
EXAMPLE = "python -m engine report scene"
LOG_IN = "project"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--title", help="title of the report (default: the name of the photo folder)")
    add_device_option(parser, "render the pictures")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write report.json and report.html."""
    from ...delivery.report import build_report
    from ...rasterizer import Device, choose_device, device_words, run_on

    with ProjectFolder.open_existing(options.project) as project:
        project.require_intact("cameras", "training")

        def build(device: Device) -> list[Path]:
            return build_report(project, backend=device.backend, title=options.title)

        pages, device = run_on(choose_device(options.device), build)
        if project.stage_record("report") is not None:
            # The report is an output of that stage, which would take it for damaged.
            project.record_outputs("report", pages)
    words = f"Its pictures were rendered on {device_words(device.name, device.reason)}."
    emit(Finished(f"The report is {pages[0]}. {words}", {"report": str(pages[0]), "device": device.name}))
    return 0
