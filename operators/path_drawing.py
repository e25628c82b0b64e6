"""Base class of the operators for which the user draws a lasso or a box in the 3D view. Not an operator itself."""

from __future__ import annotations

from typing import Any

import bpy
import gpu
import numpy as np
from bpy.app.translations import pgettext_n
from bpy.props import EnumProperty
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.ruler_view import MARK_COLOR
from .view_tool import ViewTool

_HELP = {
    "LASSO": pgettext_n("Drag around what you mean"),
    "BOX": pgettext_n("Drag from one corner of a box to the other"),
}
_MIN_STEP = 4
"""Pixels between two corners of a lasso."""


@call_properties
class PathOperator(ViewTool, bpy.types.Operator):
    """Collects the corners of a region; a subclass says what they mean."""

    shape: str = EnumProperty(
        name="Shape",
        description="How the region is drawn",
        items=[
            ("LASSO", "Lasso", "Drag around what you mean"),
            ("BOX", "Box", "Drag from one corner of a box to the other"),
        ],
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for the mouse button; with arguments of a script, run at once."""
        if self.path:  # type: ignore[attr-defined]
            return self.execute(context)
        return self.begin_path(context, event)

    def begin_path(self, context: bpy.types.Context, event: bpy.types.Event | None) -> set[str]:
        """Begin the region where the mouse was pressed when it is dragged already, or else wait for the button."""
        self._corners: list[tuple[float, float]] = []
        self._drags, self._button = False, "LEFTMOUSE"
        result = self.begin(context)
        if event is not None and event.value == "CLICK_DRAG":
            self._drags, self._button = True, event.type
            self._corners = [self.place(event.mouse_prev_press_x, event.mouse_prev_press_y)]
            self._move_to(self.place(event.mouse_x, event.mouse_y))
        return result

    def header(self) -> str:
        """Return what to do now."""
        return translated(_HELP[self.shape])

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        place = self.place(event.mouse_x, event.mouse_y)
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            if not self.is_in_view(event.mouse_x, event.mouse_y):
                return {"PASS_THROUGH"}
            self._drags, self._corners = True, [place]
        elif event.type == "MOUSEMOVE" and self._drags:
            self._move_to(place)
        elif event.type == self._button and event.value == "RELEASE" and self._drags:
            self._move_to(place)
            corners, region = np.array(self._outline(), np.float64), self.region
            view = self.area.spaces.active.region_3d
            self.cancel(context)
            return self.drawn(context, region, view, corners)
        else:
            return {"PASS_THROUGH"} if not self._drags else {"RUNNING_MODAL"}
        self.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def drawn(self, context: bpy.types.Context, region: Any, view: Any, corners: NDArray[np.float64]) -> set[str]:
        """Return the result of the operator for a region, [C, 2] in pixels from the lower left corner of the view."""
        raise NotImplementedError

    def _move_to(self, place: tuple[float, float]) -> None:
        if self.shape == "BOX":
            self._corners[1:] = [place]
        elif np.hypot(*np.subtract(place, self._corners[-1])) >= _MIN_STEP:
            self._corners.append(place)

    def _outline(self) -> list[tuple[float, float]]:
        if self.shape != "BOX" or len(self._corners) < 2:
            return self._corners
        (x0, y0), (x1, y1) = self._corners
        return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]

    def draw_marks(self) -> None:
        """Draw the region so far."""
        if len(self._corners) < 2:
            return
        outline = self._outline()
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        batch = batch_for_shader(shader, "LINE_STRIP", {"pos": [*outline, outline[0]]})
        shader.uniform_float("color", MARK_COLOR)
        batch.draw(shader)
