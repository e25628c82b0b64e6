"""Code that the operators that work on a project share. Not an operator itself."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.moved_projects import is_missing
from ..gaussian_heritage_addon.splats.selection import active_object

WATERTIGHT = BoolProperty(
    name="Watertight",
    description="Close the mesh where no photo saw the object, for printing. What is made up has a material of its own",
)


class ProjectOperator:
    """Part of an operator that can be used while a project is open."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a project is open; if not, the tooltip of the disabled button says what to do."""
        properties = context.scene.heritage
        if is_missing(properties):
            cls.poll_message_set(translated("The project is missing. Press Find Project."))  # type: ignore[attr-defined]
            return False
        cls.poll_message_set(  # type: ignore[attr-defined]
            translated("Import a photo folder or open a project first.")
        )
        return bool(properties.project)


def listed_object(scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the isolated object that is selected in the list; raises `ObjectError` when none is."""
    obj = active_object(scene)
    if obj is None:
        raise ObjectError("Select an isolated object in the list first.")
    return obj


def require_stored(objects: Iterable[bpy.types.Object]) -> None:
    """Raise `ObjectError` when one of `objects` has edits that its project does not have."""
    edited = [obj.name for obj in objects if obj.heritage.is_edited]
    if edited:
        raise ObjectError(f"{', '.join(edited)} was edited by hand. Store its edits first, or undo them.")


def start_job(operator: bpy.types.Operator, kind: str, project: Path, *arguments: str) -> set[str]:
    """Run the engine with `arguments`, report it, and return what ``execute`` returns; errors as `job_runner.start`."""
    state = job_runner.start(kind, project, *arguments)
    operator.report({"INFO"}, "Working in the background; see the Heritage panel." if state is None else state.message)
    return {"FINISHED"}
