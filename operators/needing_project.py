"""When operators that work on a project can be used."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.moved_projects import is_missing

__all__ = ["is_project_open"]


def is_project_open(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Return whether a project is open; if not, the tooltip of the disabled button says what to do."""
    properties = context.scene.heritage
    if is_missing(properties):
        operator.poll_message_set(translated("The project is missing. Press Find Project."))
        return False
    operator.poll_message_set(translated("Import a photo folder or open a project first."))
    return bool(properties.project)
