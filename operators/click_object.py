"""Isolate or correct an object by clicks on one or several photos, seen through their cameras."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import BoolProperty

from ..engine.errors import HeritageError, ObjectError
from ..engine.jobs import Click
from ..gaussian_heritage_addon.click_masks import ClickMasks
from ..gaussian_heritage_addon.click_session import ClickSession, EventResult
from ..gaussian_heritage_addon.clicking import Viewport
from ..gaussian_heritage_addon.guards import add_draw_handler, remove_draw_handler
from ..gaussian_heritage_addon.problems import sentence_of
from ..gaussian_heritage_addon.properties import active_object
from ..gaussian_heritage_addon.translations import translated
from ..gaussian_heritage_addon.typed_properties import blender_properties
from .segmenting import SegmentOperator

__all__ = ["CLASSES"]

_HELP = pgettext_n(
    "Click: the object   Shift-click: not part of it   Left/Right: other photo   Backspace: remove last click   "
    "Enter: isolate   Esc: cancel   |   {} on the object, {} beside it"
)


@blender_properties
class HERITAGE_OT_click_object(SegmentOperator):
    """Click an object on its photos. Shift-click what is not part of it, and press Enter to finish"""

    bl_idname = "heritage.click_object"
    bl_label = "Click Object"
    _handler = None

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
        raise ObjectError("Objects are clicked in a window. In scripts, call heritage.isolate with clicks.")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look through the camera of a photo and start the modal operator."""
        if self.refine and active_object(context.scene) is None:
            raise ObjectError("Select an isolated object in the list first.")
        self._viewport = Viewport.of(context)
        self._session, self._directions = ClickSession(), dict[Click, tuple[float, float]]()
        corrected = active_object(context.scene) if self.refine else None
        object_id = "" if corrected is None else corrected.heritage.object_id
        self._masks = ClickMasks(self._viewport, object_id, self._update_header)
        self._masks.start()
        self._masks.ask(())
        self._handler = add_draw_handler(bpy.types.SpaceView3D, self._draw)
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
            # Not the end: the next click may hit the photo.
            self.report({"WARNING"}, sentence_of(error))
            return {"RUNNING_MODAL"}
        if result is EventResult.IGNORED:
            return {"PASS_THROUGH"}
        if result in (EventResult.CONFIRMED, EventResult.CANCELLED):
            self.cancel(context)
            return self._isolate() if result is EventResult.CONFIRMED else {"CANCELLED"}
        self._masks.ask(session.clicks)
        self._update_header()
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Clean up, also when Blender cancels the operator, for example when it closes, or an error ended it."""
        if self._handler is None:
            return
        handler, self._handler = self._handler, None
        remove_draw_handler(bpy.types.SpaceView3D, handler)
        self._masks.close()
        self._viewport.area.header_text_set(None)
        self._viewport.area.tag_redraw()

    def _click(self, event: bpy.types.Event, wanted: bool) -> Click:
        click, self._directions[click] = self._viewport.click(event.mouse_x, event.mouse_y, wanted)
        return click

    def _draw(self) -> None:
        # Blender calls this for every 3D viewport.
        if bpy.context.area == self._viewport.area:
            self._masks.draw()
            self._viewport.draw_marks([(click, self._directions[click]) for click in self._session.clicks])

    def _update_header(self) -> None:
        help_text, status = translated(_HELP, *self._session.counts()), translated(self._masks.status())
        self._viewport.area.header_text_set(f"{help_text}   |   {status}" if status else help_text)
        self._viewport.area.tag_redraw()

    def _isolate(self) -> set[str]:
        clicks = [
            {"name": "", "photo": click.photo, "x": click.x, "y": click.y, "wanted": click.wanted}
            for click in self._session.clicks
        ]
        try:
            operator = bpy.ops.heritage.refine_object if self.refine else bpy.ops.heritage.isolate
            operator(clicks=clicks)
        except RuntimeError as error:
            # The sentence that the called operator reported.
            raise HeritageError(str(error).strip().removeprefix("Error: ")) from error
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_click_object]
