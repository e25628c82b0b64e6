"""The device that a reconstruction trains on, from the plan that the engine stored in the project. No bpy."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import HeritageError
from ...engine.core.files import read_after_change
from ...engine.project.folder import PROJECT_FILE, ProjectFolder

_PROCESSOR = "cpu"


@read_after_change(PROJECT_FILE)
def planned_device(project: Path) -> str:
    """Return a sentence about the device, with the reason if it is not the card; empty before there is a plan."""
    try:
        device = ProjectFolder.open_existing(project).get("work_plan")["device"]
        name, reason = str(device["name"]), str(device["reason"])
    except (HeritageError, KeyError, TypeError):
        return ""
    because = f", because {reason}" if reason else ""
    return f"Trains on {'the processor' if name == _PROCESSOR else name}{because}"
