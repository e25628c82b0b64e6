"""What all operators that ask the engine's ``segment`` have in common. Not an operator itself."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon import job_runner
from ..gaussian_heritage_addon.preferences import sam_arguments
from ..gaussian_heritage_addon.prompts import Click

__all__ = ["Segmenting", "clicks_of"]


class Segmenting:
    """Starts the engine with `what` it is asked for; the objects are added or changed when it is done."""

    loads_sam = True
    """Whether Segment Anything is asked, so that the preference for one of its models is passed on."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where a project is open."""
        cls.poll_message_set("Import a photo folder or open a project first.")  # type: ignore[attr-defined]
        return bool(context.scene.heritage.project)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        try:
            project = Path(bpy.path.abspath(context.scene.heritage.project))
            arguments = ["segment", str(project), *self.what(context), *(sam_arguments() if self.loads_sam else [])]
            state = job_runner.start("segment", project, *arguments)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        told = "Working in the background; see the Heritage panel." if state is None else state.message
        self.report({"INFO"}, told)  # type: ignore[attr-defined]
        return {"FINISHED"}

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for what was asked."""
        raise NotImplementedError


def clicks_of(operator: bpy.types.Operator) -> list[Click]:
    """Return the clicks that an operator was called with."""
    return [Click(click.photo, click.x, click.y, click.wanted) for click in operator.clicks]
