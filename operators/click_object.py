"""Click an object on a photo, looking through the photo's camera; several clicks and photos until Enter."""

from __future__ import annotations

import bpy

from ..engine.errors import HeritageError, ObjectError
from ..gaussian_heritage_addon.clicking import Viewport
from ..gaussian_heritage_addon.prompts import Answer, Click, ClickSession
from ..gaussian_heritage_addon.properties import active_object
from .segmenting import Segmenting

__all__ = ["CLASSES"]

_HELP = "Click: the object   Shift-click: not part of it   Left/Right: other photo   Backspace: take back   "
_HELP += "Enter: isolate   Esc: stop   |   "


class HERITAGE_OT_click_object(Segmenting, bpy.types.Operator):
    """Click an object through a photo's camera: Shift-click what is not part of it, Enter when done"""

    bl_idname = "heritage.click_object"
    bl_label = "Click Object"

    refine: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Correct", description="The chosen object, instead of isolating a new one", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Refuse without a window; scripts give the pixels to `heritage.isolate` or `heritage.refine_object`."""
        self.report({"ERROR"}, "Objects are clicked in a window. Scripts call heritage.isolate with clicks.")
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look through a photo's camera and wait for clicks."""
        try:
            if self.refine and active_object(context.scene) is None:
                raise ObjectError("Choose an isolated object in the list first.")
            self._viewport = Viewport.of(context)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._session, self._directions = ClickSession(), dict[Click, tuple[float, float]]()
        self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.window_manager.modal_handler_add(self)
        self._tell()
        if self._viewport.note:
            self.report({"WARNING"}, self._viewport.note)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Take one event of the window."""
        viewport, session = self._viewport, self._session
        if not viewport.is_over(event.mouse_x, event.mouse_y):
            return {"PASS_THROUGH"}
        try:
            answer = session.handle(
                event.type,
                pressed=event.value == "PRESS",
                negative=event.shift or event.ctrl,
                click=lambda wanted: self._click(event, wanted),
            )
            if answer is Answer.OTHER_PHOTO:
                viewport.show_photo(session.step)
                if viewport.note:
                    self.report({"WARNING"}, viewport.note)
        except HeritageError as error:
            self.report({"WARNING"}, str(error))
            return {"RUNNING_MODAL"}
        if answer is Answer.LEAVE:
            return {"PASS_THROUGH"}
        if answer in (Answer.DONE, Answer.STOPPED):
            return self._end(answer)
        self._tell()
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Clean up when Blender stops the operator, for instance as it closes."""
        self._end(Answer.STOPPED)

    def _click(self, event: bpy.types.Event, wanted: bool) -> Click:
        click, self._directions[click] = self._viewport.click(event.mouse_x, event.mouse_y, wanted)
        return click

    def _draw(self) -> None:
        # Blender calls this for every 3D viewport.
        if bpy.context.area == self._viewport.area:
            self._viewport.draw_marks([(click, self._directions[click]) for click in self._session.clicks])

    def _tell(self) -> None:
        self._viewport.area.header_text_set(_HELP + self._session.line())
        self._viewport.area.tag_redraw()

    def _end(self, answer: Answer) -> set[str]:
        bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
        self._viewport.area.header_text_set(None)
        self._viewport.area.tag_redraw()
        if answer is Answer.STOPPED:
            return {"CANCELLED"}
        clicks = [
            {"name": "", "photo": click.photo, "x": click.x, "y": click.y, "wanted": click.wanted}
            for click in self._session.clicks
        ]
        try:
            run = bpy.ops.heritage.refine_object if self.refine else bpy.ops.heritage.isolate
            run(clicks=clicks)
        except RuntimeError as error:
            # How Blender hands on what the other operator reported.
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_click_object]
