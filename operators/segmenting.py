"""Base class of the operators that run the engine's ``segment`` command. Not an operator itself."""

from __future__ import annotations

import bpy

from ..engine.workers.jobs import Click
from ..gaussian_heritage_addon.setup.preferences import sam_arguments
from ..gaussian_heritage_addon.splats.properties import project_of
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from .project_operator import ProjectOperator, start_job


class SegmentOperator(ProjectOperator, bpy.types.Operator):
    """Runs ``segment`` with the arguments of a subclass. The results are imported when the engine has finished."""

    loads_sam = True
    """Whether the engine loads Segment Anything, so that the model set in the preferences is passed on."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first where something is replaced."""
        replaced = self.replaces(context)
        if not replaced:
            return self.execute(context)
        answer: set[str] = context.window_manager.invoke_confirm(
            self, event, title=self.bl_label, message=replaced, confirm_text="Replace"
        )
        return answer

    def replaces(self, context: bpy.types.Context) -> str:
        """Return a sentence on what goes to the project's trash; empty where nothing does."""
        return ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        project = project_of(context.scene.heritage)
        options = [*self.segment_arguments(context), *(sam_arguments() if self.loads_sam else [])]
        return start_job(self, "segment", project, "segment", str(project), *options)

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the arguments of ``segment`` after the project folder."""
        raise NotImplementedError


def replaced_background(scene: bpy.types.Scene) -> str:
    """Return the sentence for a step that makes a new background; empty where there is none yet."""
    names = [obj.name for obj in heritage_objects(scene, "OBJECT") if obj.heritage.kind == "background"]
    return f"{names[0]} is made anew. The present one goes to the project's trash." if names else ""


def clicks_of(operator: bpy.types.Operator) -> list[Click]:
    """Return the clicks that `operator` was called with."""
    return [Click(click.photo, click.x, click.y, click.wanted) for click in operator.clicks]
