"""Isolate or correct an object by clicks on one or several photos, seen through their cameras."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import BoolProperty

from ..engine.errors import HeritageError, ObjectError
from ..gaussian_heritage_addon.clicking import Viewport
from ..gaussian_heritage_addon.prompts import Click, ClickSession, EventResult
from ..gaussian_heritage_addon.properties import active_object
from ..gaussian_heritage_addon.typed_properties import blender_properties
from .segmenting import SegmentOperator

__all__ = ["CLASSES"]

_HELP = "Click: the object   Shift-click: not part of it   Left/Right: other photo   Backspace: remove last click   "
_HELP += "Enter: isolate   Esc: cancel   |   "


@blender_properties
class HERITAGE_OT_click_object(SegmentOperator):
    """Click an object on its photos. Shift-click what is not part of it, and press Enter to finish"""

    bl_idname = "heritage.click_object"
    bl_label = "Click Object"

    refine: Annotated[
        bool,
        BoolProperty(
            name="Correct",
            description="Correct the selected object instead of isolating a new one",
            options={"SKIP_SAVE"},
        ),
    ]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Report an error: scripts pass clicks to `heritage.isolate` or `heritage.refine_object` instead."""
        self.report({"ERROR"}, "Objects are clicked in a window. In scripts, call heritage.isolate with clicks.")
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look through the camera of a photo and start the modal operator."""
        try:
            if self.refine and active_object(context.scene) is None:
                raise ObjectError("Select an isolated object in the list first.")
            self._viewport = Viewport.of(context)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._session, self._directions = ClickSession(), dict[Click, tuple[float, float]]()
        self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.window_manager.modal_handler_add(self)
        self._update_header()
        if self._viewport.photo_problem:
            self.report({"WARNING"}, self._viewport.photo_problem)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        viewport, session = self._viewport, self._session
        if not viewport.is_over(event.mouse_x, event.mouse_y):
            return {"PASS_THROUGH"}
        try:
            result = session.handle(
                event.type,
                pressed=event.value == "PRESS",
                negative=event.shift or event.ctrl,
                click=lambda wanted: self._click(event, wanted),
            )
            if result is EventResult.CHANGE_PHOTO:
                viewport.show_photo(session.step)
                if viewport.photo_problem:
                    self.report({"WARNING"}, viewport.photo_problem)
        except HeritageError as error:
            self.report({"WARNING"}, str(error))
            return {"RUNNING_MODAL"}
        if result is EventResult.IGNORED:
            return {"PASS_THROUGH"}
        if result in (EventResult.CONFIRMED, EventResult.CANCELLED):
            return self._finish(result)
        self._update_header()
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Clean up when Blender cancels the operator, for example when it closes."""
        self._finish(EventResult.CANCELLED)

    def _click(self, event: bpy.types.Event, wanted: bool) -> Click:
        click, self._directions[click] = self._viewport.click(event.mouse_x, event.mouse_y, wanted)
        return click

    def _draw(self) -> None:
        # Blender calls this for every 3D viewport.
        if bpy.context.area == self._viewport.area:
            self._viewport.draw_marks([(click, self._directions[click]) for click in self._session.clicks])

    def _update_header(self) -> None:
        self._viewport.area.header_text_set(_HELP + self._session.summary())
        self._viewport.area.tag_redraw()

    def _finish(self, result: EventResult) -> set[str]:
        bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
        self._viewport.area.header_text_set(None)
        self._viewport.area.tag_redraw()
        if result is EventResult.CANCELLED:
            return {"CANCELLED"}
        clicks = [
            {"name": "", "photo": click.photo, "x": click.x, "y": click.y, "wanted": click.wanted}
            for click in self._session.clicks
        ]
        try:
            operator = bpy.ops.heritage.refine_object if self.refine else bpy.ops.heritage.isolate
            operator(clicks=clicks)
        except RuntimeError as error:
            # The error that the called operator reported.
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_click_object]
