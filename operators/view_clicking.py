"""Base class of the operators for which the user clicks in the 3D view. Not an operator itself."""

from __future__ import annotations

import blf
import bpy
import numpy as np

from ..engine.core.arrays import Float64
from ..engine.core.errors import HeritageError
from ..gaussian_heritage_addon.blender.problems import sentence_of
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.ruler_view import MARK_COLOR
from ..gaussian_heritage_addon.project.visible_splats import sight_of_viewport
from .project_operator import ProjectOperator
from .view_tool import ViewTool

_MARK_SIZE = 24


class ViewClickOperator(ViewTool, ProjectOperator, bpy.types.Operator):
    """Collects clicks in the 3D view as rays of Blender's world; a subclass says what they mean."""

    n_clicks = 0
    """Clicks after which the operator ends; 0: it ends with Enter."""
    help_text = ""

    def begin_clicks(self, context: bpy.types.Context) -> set[str]:
        """Wait for clicks in the view, and return what `invoke` returns."""
        self.rays: list[tuple[Float64, Float64]] = []
        self.points: list[Float64] = []
        return self.begin(context)

    def header(self) -> str:
        """Return what to do now."""
        return translated(self.help_text)

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        is_in_view = self.is_in_view(event.mouse_x, event.mouse_y)
        if event.type in ("RET", "NUMPAD_ENTER") and event.value == "PRESS" and not self.n_clicks:
            return self._end(context)
        if event.type == "BACK_SPACE" and event.value == "PRESS" and is_in_view:
            del self.rays[-1:], self.points[-1:]
            self.area.tag_redraw()
            return {"RUNNING_MODAL"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS" or not is_in_view:
            return {"PASS_THROUGH"}
        try:
            sight = sight_of_viewport(self.region, self.area.spaces.active.region_3d)
            self.add(context, sight.ray(*self.place(event.mouse_x, event.mouse_y)))
        except HeritageError as error:
            # Not the end: the next click may hit something.
            self.report({"WARNING"}, sentence_of(error))
            return {"RUNNING_MODAL"}
        self.area.tag_redraw()
        return self._end(context) if len(self.rays) == self.n_clicks else {"RUNNING_MODAL"}

    def add(self, context: bpy.types.Context, ray: tuple[Float64, Float64]) -> None:
        """Take a click; a subclass may refuse it with a `HeritageError`, or append the point that it hits."""
        self.rays.append(ray)

    def clicked(self, context: bpy.types.Context) -> set[str]:
        """Return the result of the operator, when all clicks are made."""
        raise NotImplementedError

    def _end(self, context: bpy.types.Context) -> set[str]:
        self.cancel(context)
        return self.clicked(context)

    def draw_marks(self) -> None:
        """Draw a number at each point."""
        if not self.points:
            return
        sight = sight_of_viewport(self.region, self.area.spaces.active.region_3d)
        blf.size(0, _MARK_SIZE)
        blf.color(0, *MARK_COLOR)
        for number, (x, y) in enumerate(sight.positions(np.array(self.points)), 1):
            if np.isfinite((x, y)).all():
                blf.position(0, x + 4, y + 4, 0)
                blf.draw(0, f"\N{MULTIPLICATION X}{number}")
