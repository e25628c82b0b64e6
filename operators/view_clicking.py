"""Base class of the operators for which the user clicks in the 3D view. Not an operator itself."""

from __future__ import annotations

from typing import Any

import blf
import bpy
import numpy as np
from bpy.app.translations import pgettext_n
from numpy.typing import NDArray

from ..engine.errors import HeritageError, ObjectError
from ..gaussian_heritage_addon.guards import add_draw_handler, remove_draw_handler
from ..gaussian_heritage_addon.problems import sentence_of
from ..gaussian_heritage_addon.translations import translated
from ..gaussian_heritage_addon.visible_splats import sight_of_viewport
from .needing_project import is_project_open

__all__ = ["ViewClickOperator"]

Float64 = NDArray[np.float64]

_MARK_SIZE = 24
_MARK_COLOR = (1.0, 0.75, 0.2, 1.0)


class ViewClickOperator(bpy.types.Operator):
    """Collects clicks in the 3D view as rays of Blender's world; a subclass says what they mean."""

    n_clicks = 0
    """Clicks after which the operator ends; 0: it ends with Enter."""
    help_text = pgettext_n("Click in the view   Backspace: remove the last   Enter: done   Esc: cancel")
    _handler: Any = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a project is open."""
        return is_project_open(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for clicks in the view."""
        if context.area is None or context.area.type != "VIEW_3D":
            raise ObjectError("Press the button in the sidebar (N) of a 3D view.")
        self._area = context.area
        self.rays: list[tuple[Float64, Float64]] = []
        self.points: list[Float64] = []
        self._handler = add_draw_handler(bpy.types.SpaceView3D, self._draw)
        context.window_manager.modal_handler_add(self)
        self._area.header_text_set(translated(self.help_text))
        self._area.tag_redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type in ("RET", "NUMPAD_ENTER") and event.value == "PRESS" and not self.n_clicks:
            return self._end(context)
        if event.type == "BACK_SPACE" and event.value == "PRESS":
            del self.rays[-1:], self.points[-1:]
            self._area.tag_redraw()
            return {"RUNNING_MODAL"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS" or not self._is_over(event):
            return {"PASS_THROUGH"}
        try:
            region = self._region
            x, y = event.mouse_x - region.x + 0.5, event.mouse_y - region.y + 0.5
            ray = sight_of_viewport(region, self._area.spaces.active.region_3d).ray(x, y)
            self.add(context, ray)
        except HeritageError as error:
            # Not the end: the next click may hit something.
            self.report({"WARNING"}, sentence_of(error))
            return {"RUNNING_MODAL"}
        self._area.tag_redraw()
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

    def cancel(self, context: bpy.types.Context) -> None:
        """Clean up, also when Blender cancels the operator, or an error ended it."""
        if self._handler is None:
            return
        handler, self._handler = self._handler, None
        remove_draw_handler(bpy.types.SpaceView3D, handler)
        self._area.header_text_set(None)
        self._area.tag_redraw()

    @property
    def _region(self) -> bpy.types.Region:
        return next(region for region in self._area.regions if region.type == "WINDOW")

    def _is_over(self, event: bpy.types.Event) -> bool:
        def inside(region: bpy.types.Region) -> bool:
            right, top = region.x + region.width, region.y + region.height
            return region.x <= event.mouse_x < right and region.y <= event.mouse_y < top

        # A closed region has a width or height of 1.
        others = [one for one in self._area.regions if one.type != "WINDOW" and min(one.width, one.height) > 1]
        return inside(self._region) and not any(map(inside, others))

    def _draw(self) -> None:
        if bpy.context.area != self._area or not self.points:
            return
        sight = sight_of_viewport(self._region, self._area.spaces.active.region_3d)
        blf.size(0, _MARK_SIZE)
        blf.color(0, *_MARK_COLOR)
        for number, (x, y) in enumerate(sight.positions(np.array(self.points)), 1):
            if np.isfinite((x, y)).all():
                blf.position(0, x + 4, y + 4, 0)
                blf.draw(0, f"\N{MULTIPLICATION X}{number}")
