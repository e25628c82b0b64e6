"""The device that a reconstruction trains on, from the plan that the engine stored in the project. No bpy."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import HeritageError
from ...engine.core.files import read_after_change
from ...engine.project.folder import PROJECT_FILE, ProjectFolder


@read_after_change(PROJECT_FILE)
def planned_device(project: Path) -> tuple[str, str] | None:
    """Return the device, ``cpu`` for the processor, and why it is not the card; None before there is a plan."""
    try:
        device = ProjectFolder.open_existing(project).get("work_plan")["device"]
        return str(device["name"]), str(device["reason"])
    except (HeritageError, KeyError, TypeError):
        return None
