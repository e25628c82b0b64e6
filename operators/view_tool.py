"""Tools that wait for the mouse in a 3D view: one at a time, named in the header of the view until it ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.translations import pgettext_n

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.guards import add_draw_handler, remove_draw_handler
from ..gaussian_heritage_addon.language.translations import translated

_HEADER = pgettext_n("{}: {}   Esc: leave")
_MOVES = frozenset(("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "TIMER", "TIMER_REPORT", "TIMER_REGION", "WINDOW_DEACTIVATE"))
"""Types of events after which the header of the view is as it was."""


class _Session:
    """Changes of a tool in Blender's window, from its begin to its end."""

    def __init__(self, context: bpy.types.Context, draw: Callable[[], None]) -> None:
        self.area, self.scene, self._manager = context.area, context.scene, context.window_manager
        self.is_over = False
        self._draw = draw
        self._handler = add_draw_handler(bpy.types.SpaceView3D, self._draw_here)

    def end(self) -> None:
        """Draw nothing any more, and give the header back."""
        if not self.is_over:
            self.is_over = True
            remove_draw_handler(bpy.types.SpaceView3D, self._handler)
            if self.is_shown():
                self.area.header_text_set(None)
                self.area.tag_redraw()

    def is_shown(self) -> bool:
        """Return whether the view is still in a window: it may have been closed, or its workspace left."""
        return any(area == self.area for window in self._manager.windows for area in window.screen.areas)

    def _draw_here(self) -> None:
        # Blender calls this for every 3D view.
        if not self.is_over and bpy.context.area == self.area:
            self._draw()


_last: _Session | None = None
"""Of the tool that began last. It does not refer to the operator, which Blender may free at any time."""


def end_active_tool() -> None:
    """End the tool that waits for the mouse, as Escape does."""
    if _last is not None:
        _last.end()


class ViewTool:
    """Part of a modal operator that works in one 3D view, from `begin` until it ends or another tool begins."""

    _session: _Session | None = None
    _has_header = False

    def begin(self, context: bpy.types.Context) -> set[str]:
        """End the tool that was active, take the events of the view, and return what `invoke` returns.

        Raises
        ------
        ObjectError
            When `context` is not a 3D view.
        """
        global _last
        if context.area is None or context.area.type != "VIEW_3D":
            raise ObjectError("Press the button in the sidebar (N) of a 3D view.")
        end_active_tool()
        self._session = _last = _Session(context, self.draw_marks)
        self.show_header()
        # Last: an error after this would leave Blender with an operator that has ended already.
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        session = self._session
        if session is None or session.is_over or context.scene != session.scene or not session.is_shown():
            # Another tool has begun, or the view is gone. The event belongs to others.
            self.cancel(context)
            return {"CANCELLED", "PASS_THROUGH"}
        is_in_view = self.is_in_view(event.mouse_x, event.mouse_y)
        if event.value == "PRESS" and (event.type == "ESC" or (event.type == "RIGHTMOUSE" and is_in_view)):
            self.cancel(context)
            return {"CANCELLED"}
        if not self._has_header:
            self.show_header()
        result = self.handle(context, event)
        if "PASS_THROUGH" in result and event.type not in _MOVES:
            # What Blender does with the event, such as moving an object, may put another text into the header.
            self._has_header = False
        return result

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event that does not end the tool."""
        raise NotImplementedError

    def draw_marks(self) -> None:
        """Draw what was clicked, in pixels of the region of the view."""

    def header(self) -> str:
        """Return what to do now, in the language of the user, for the header of the view."""
        raise NotImplementedError

    def tool_name(self) -> str:
        """Return the name of the tool, as its button has it, in English."""
        raise NotImplementedError

    def show_header(self) -> None:
        """Say in the header of the view which tool is active, what to do now, and how to leave it."""
        self.area.header_text_set(translated(_HEADER, translated(self.tool_name()), self.header()))
        self.area.tag_redraw()
        self._has_header = True

    def cancel(self, context: bpy.types.Context) -> None:
        """End the tool, also when Blender cancels the operator, or an error ended it."""
        if self._session is not None:
            self._session.end()

    def is_active(self) -> bool:
        """Return whether the tool waits for the mouse, in a view that is still there."""
        return self._session is not None and not self._session.is_over and self._session.is_shown()

    @property
    def area(self) -> bpy.types.Area:
        """The 3D view."""
        assert self._session is not None
        return self._session.area

    @property
    def region(self) -> bpy.types.Region:
        """The region of the view in which the scene is drawn."""
        return next(region for region in self.area.regions if region.type == "WINDOW")

    def place(self, x: int, y: int) -> tuple[float, float]:
        """Return the middle of the pixel (x, y) of the window, in pixels from the lower left corner of the view."""
        return x - self.region.x + 0.5, y - self.region.y + 0.5

    def is_in_view(self, x: int, y: int) -> bool:
        """Return whether the position (x, y) in the window is in the view, not on a header or sidebar over it."""

        def inside(region: Any) -> bool:
            return bool(region.x <= x < region.x + region.width and region.y <= y < region.y + region.height)

        # A closed region has a width or height of 1.
        others = [one for one in self.area.regions if one.type != "WINDOW" and min(one.width, one.height) > 1]
        return inside(self.region) and not any(map(inside, others))
