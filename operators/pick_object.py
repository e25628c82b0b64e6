"""Click in the view: select the isolated object that is seen there, or isolate what is seen there."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ..engine.core.arrays import Float64
from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.project.visible_splats import (
    SplatsInView,
    cameras_of,
    photo_of_point,
    sight_of_photo,
)
from ..gaussian_heritage_addon.splats.selection import set_active_object
from .view_clicking import ViewClickOperator


@call_properties
class HERITAGE_OT_pick_object(ViewClickOperator):
    """Click in the 3D view. Select: the isolated object that you see there. Isolate: make an object of what you see"""

    bl_idname = "heritage.pick_object"
    bl_label = "Click in View"
    bl_options = {"REGISTER", "UNDO"}
    n_clicks = 1
    help_text = pgettext_n("Click what you see")

    action: str = EnumProperty(
        name="Action",
        description="What a click does",
        items=[
            ("SELECT", "Select", "Select the isolated object that is seen at the click"),
            ("ISOLATE", "Isolate", "Isolate the thing that is seen at the click as a new object"),
        ],
    )
    photo: str = StringProperty(name="Photo", description="For scripts: look through this photo instead of the 3D view")
    x: float = FloatProperty(name="X", description="For scripts: pixels from the left edge of the photo")
    y: float = FloatProperty(name="Y", description="For scripts: pixels from the top edge of the photo")
    name: str = StringProperty(name="Name", description="Name of an isolated object; empty: object")

    def tool_name(self) -> str:
        """Return the label of its button."""
        return "Select in View" if self.action == "SELECT" else "Isolate in View"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for a click in the view; with a photo, look through it at once."""
        return self.execute(context) if self.photo else self.begin_clicks(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Look through the photo."""
        if not self.photo:
            raise ObjectError("Give the photo and the pixel to look at: photo, x, y. In a window, click in the view.")
        return self._pick(context, *sight_of_photo(context.scene, self.photo).ray(self.x, self.y))

    def clicked(self, context: bpy.types.Context) -> set[str]:
        """Look along the ray of the click."""
        return self._pick(context, *self.rays[-1])

    def _pick(self, context: bpy.types.Context, origin: Float64, direction: Float64) -> set[str]:
        scene = context.scene
        splats = SplatsInView.of(scene)
        seen = splats.seen(origin, direction)
        name = splats.name_of(seen)
        if self.action == "ISOLATE":
            if seen.point is None:
                raise ObjectError("There is no surface at this place. Click on something that is not transparent.")
            click = photo_of_point(scene, cameras_of(scene), seen.point, direction)
            bpy.ops.heritage.isolate(photo=click.photo, x=click.x, y=click.y, name=self.name)
            self.report({"INFO"}, f"Isolating what {click.photo} shows at {click.x:.0f}, {click.y:.0f}.")
            return {"FINISHED"}
        if not name:
            self.report({"INFO"}, "No isolated object is seen there. Use Isolate to make one.")
            return {"CANCELLED"}
        set_active_object(scene, bpy.data.objects[name])
        self.report({"INFO"}, f"{name} is selected.")
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_pick_object]
