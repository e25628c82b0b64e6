"""Isolate or correct an object by clicks on one or several photos, seen through their cameras."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import BoolProperty

from ..engine.core.errors import HeritageError, ObjectError
from ..engine.workers.jobs import Click
from ..gaussian_heritage_addon.blender.problems import sentence_of
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs.click_masks import ClickMasks
from ..gaussian_heritage_addon.jobs.click_session import CONFIRM_KEYS, ClickSession, EventResult
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.clicking import Viewport
from ..gaussian_heritage_addon.splats.selection import active_object, set_active_object
from .project_operator import listed_object
from .segmenting import SegmentOperator
from .view_tool import ViewTool, end_active_tool

_HELP = pgettext_n(
    "Click: the object   Shift-click: not part of it   Left/Right: other photo   Backspace: remove last click   "
    "Enter: done   |   {} on the object, {} beside it"
)


@call_properties
class HERITAGE_OT_click_object(ViewTool, SegmentOperator):
    """Click an object on its photos. Shift-click what is not part of it, and press Enter to finish"""

    bl_idname = "heritage.click_object"
    bl_label = "Click Object"

    refine: bool = BoolProperty(
        name="Correct", description="Correct the selected object instead of isolating a new one"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Report an error: scripts pass clicks to `heritage.isolate` or `heritage.refine_object` instead."""
        raise ObjectError("Objects are clicked in a window. In scripts, call heritage.isolate with clicks.")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look through the camera of a photo and start the modal operator."""
        target = listed_object(context.scene) if self.refine else active_object(context.scene)
        self._target = "" if target is None else target.name
        # Before the view turns to a photo.
        end_active_tool()
        self._viewport = Viewport.of(context)
        self._clicks, self._directions = ClickSession(), dict[Click, tuple[float, float]]()
        if self._viewport.photo_problem:
            self.report({"WARNING"}, self._viewport.photo_problem)
        object_id = target.heritage.object_id if self.refine and target is not None else ""
        self._masks = ClickMasks(self._viewport, object_id, self._masks_changed)
        answer = self.begin(context)
        self._masks.start()
        self._masks.ask(())
        return answer

    def tool_name(self) -> str:
        """Return the label of its button."""
        return "Correct by Clicks" if self.refine else "Click Object"

    def header(self) -> str:
        """Return what to do now, how many clicks there are, and what the masks are waiting for."""
        help_text, status = translated(_HELP, *self._clicks.counts()), translated(self._masks.status())
        return f"{help_text}   |   {status}" if status else help_text

    def cancel(self, context: bpy.types.Context) -> None:
        """End the tool and its engine process."""
        ViewTool.cancel(self, context)
        self._masks.close()

    def _masks_changed(self) -> None:
        if self.is_active():
            self.show_header()

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle one window event."""
        viewport, session = self._viewport, self._clicks
        # Enter and Escape are meant for the tool wherever the pointer is; other keys may belong to what is under it.
        if not self.is_in_view(event.mouse_x, event.mouse_y) and event.type not in CONFIRM_KEYS:
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
        if result is EventResult.CONFIRMED:
            self.cancel(context)
            return self._isolate(context)
        self._masks.ask(session.clicks)
        self.show_header()
        return {"RUNNING_MODAL"}

    def _click(self, event: bpy.types.Event, wanted: bool) -> Click:
        click, self._directions[click] = self._viewport.click(event.mouse_x, event.mouse_y, wanted)
        return click

    def draw_marks(self) -> None:
        """Draw the masks of the clicks, and the clicks, on the photo that is shown."""
        self._masks.draw()
        self._viewport.draw_marks([(click, self._directions[click]) for click in self._clicks.clicks])

    def _isolate(self, context: bpy.types.Context) -> set[str]:
        if self.refine:
            # Another object may have been selected since the button was pressed.
            target = context.scene.objects.get(self._target)
            if target is None:
                raise ObjectError(f"{self._target} is not in this scene any more. Select the object to correct again.")
            set_active_object(context.scene, target)
        clicks = [
            {"name": "", "photo": click.photo, "x": click.x, "y": click.y, "wanted": click.wanted}
            for click in self._clicks.clicks
        ]
        try:
            operator = bpy.ops.heritage.refine_object if self.refine else bpy.ops.heritage.isolate
            operator(clicks=clicks)
        except RuntimeError as error:
            # The sentence that the called operator reported.
            raise HeritageError(str(error).strip().removeprefix("Error: ")) from error
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_click_object]
