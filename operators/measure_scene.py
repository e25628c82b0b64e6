"""Measure: pick points in the view, or on photos by script, that give scale, ground, north, origin, or a ruler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, IntProperty

from ..engine.core.arrays import Float64
from ..engine.core.errors import ObjectError, SettingsError
from ..engine.scene import MeasuredDistance, Measurement, Point
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.blender.world_placement import world_matrix
from ..gaussian_heritage_addon.project.measuring import (
    add_ruler,
    current_measurement,
    follow_measurements,
    measure,
    scene_points,
)
from ..gaussian_heritage_addon.project.visible_splats import SplatsInView, sight_of_photo
from ..gaussian_heritage_addon.splats.properties import HeritageClick, project_of
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from .project_operator import ProjectOperator
from .view_clicking import ViewClickOperator

_N_POINTS = {"DISTANCE": 2, "RULER": 2, "NORTH": 2, "ORIGIN": 1, "GROUND": 0}
"""Points of each action; 0: three or more."""
_HELP = {
    "DISTANCE": pgettext_n("Click the two ends of the known distance"),
    "RULER": pgettext_n("Click two points"),
    "NORTH": pgettext_n("Click a point, then another one to the north of it"),
    "ORIGIN": pgettext_n("Click the origin"),
    "GROUND": pgettext_n("Click three or more points of the ground   Backspace: remove the last   Enter: done"),
}


@call_properties
class HERITAGE_OT_measure(ViewClickOperator):
    """Click on the splats: the ends of a known distance, points of the ground, north or the origin; or use a ruler"""

    bl_idname = "heritage.measure"
    bl_label = "Measure"
    bl_options = {"REGISTER", "UNDO"}

    action: str = EnumProperty(
        name="Action",
        description="What the points mean",
        items=[
            ("DISTANCE", "Known Distance", "Two points whose distance you know; several distances are averaged"),
            ("GROUND", "Ground", "Three or more points of the ground, which becomes level at height 0"),
            ("NORTH", "North", "Two points, the second to the north of the first; north becomes the Y axis"),
            ("ORIGIN", "Origin", "The point that becomes the origin"),
            ("RULER", "Ruler", "Two points whose distance is shown"),
        ],
    )
    metres: float = FloatProperty(
        name="Distance", description="The known distance in metres", default=1.0, min=0.0, precision=4
    )
    points_on_photos: Sequence[HeritageClick] = CollectionProperty(
        type=HeritageClick, name="Points", description="For scripts: pixels of photos instead of clicks in the view"
    )

    def tool_name(self) -> str:
        """Return the name of the action."""
        actions = bpy.ops.heritage.measure.get_rna_type().properties["action"].enum_items
        name: str = actions[self.action].name
        return name

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for clicks in the view."""
        if self.points_on_photos:
            return self.execute(context)
        self.n_clicks, self.help_text = _N_POINTS[self.action], _HELP[self.action]
        self._splats = SplatsInView.of(context.scene)
        return self.begin_clicks(context)

    def add(self, context: bpy.types.Context, ray: tuple[Float64, Float64]) -> None:
        """Take the surface that a click hits."""
        self.points.append(_surface(self._splats, ray))
        self.rays.append(ray)

    def clicked(self, context: bpy.types.Context) -> set[str]:
        """Use the points."""
        return self._use(context, self.points)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Use the pixels of photos."""
        if not self.points_on_photos:
            raise ObjectError("Give points_on_photos. In a window, press the button and click in the 3D view.")
        # A photo shows the whole scene, also while only its objects are shown.
        splats = SplatsInView.of(context.scene, only=[obj.name for obj in heritage_objects(context.scene, "SCENE")])
        rays = [sight_of_photo(context.scene, one.photo).ray(one.x, one.y) for one in self.points_on_photos]
        return self._use(context, [_surface(splats, ray) for ray in rays])

    def _use(self, context: bpy.types.Context, points: Sequence[Float64]) -> set[str]:
        scene, wanted = context.scene, _N_POINTS[self.action]
        if wanted and len(points) != wanted:
            raise SettingsError(f"{wanted} points are needed here, got {len(points)}.")
        if self.action == "RULER":
            ruler = add_ruler(scene, points[0], points[1])
            self.report({"INFO"}, f"The points are {ruler.name} apart.")
            return {"FINISHED"}
        before = current_measurement(project_of(scene.heritage))
        after = self._with(before, scene_points(scene, points))
        measure(scene, after)
        self.report({"INFO"}, _sentence(self.action, after))
        return {"FINISHED"}

    def _with(self, before: Measurement, points: list[Point]) -> Measurement:
        match self.action:
            case "DISTANCE":
                return replace(
                    before, distances=(*before.distances, MeasuredDistance(points[0], points[1], float(self.metres)))
                )
            case "GROUND":
                return replace(before, ground=tuple(points))
            case "NORTH":
                return replace(before, north=(points[0], points[1]))
        return replace(before, origin=points[0])


def _surface(splats: SplatsInView, ray: tuple[Float64, Float64]) -> Float64:
    point = splats.seen(*ray).point
    if point is None:
        raise ObjectError("There is no surface at this place. Click on what is shown, or show the whole scene.")
    return point


def _sentence(action: str, measurement: Measurement) -> str:
    if action == "DISTANCE":
        agree = measurement.scale_residual
        text = f"1 unit of the scene is {measurement.metres_per_unit:.4g} m now."
        return text if agree is None else f"{text} The distances agree within {agree * 1000:.1f} mm."
    return {"GROUND": "The ground is level now.", "NORTH": "North is the Y axis now."}.get(action, "The origin is set.")


class HERITAGE_OT_ground_from_plane(ProjectOperator, bpy.types.Operator):
    """Make the plane of the active object the ground: lay a plane on the floor by hand, then press this"""

    bl_idname = "heritage.ground_from_plane"
    bl_label = "Ground from Plane"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Use three points of the plane."""
        obj, scene = context.view_layer.objects.active, context.scene
        if obj is None or obj.heritage.role != "NONE":
            raise ObjectError("Select a plane or an empty that lies on the ground, not the splats.")
        matrix = world_matrix(obj)
        corners = [matrix[:3, 3], matrix[:3, 3] + matrix[:3, 0], matrix[:3, 3] + matrix[:3, 1]]
        before = current_measurement(project_of(scene.heritage))
        ground = tuple(scene_points(scene, corners))
        # Left behind, it would lie beside the floor, and tilt the scene when it is used again.
        follow_measurements(scene, obj)
        measure(scene, replace(before, ground=ground))
        self.report({"INFO"}, "The ground is level now.")
        return {"FINISHED"}


@call_properties
class HERITAGE_OT_clear_measurement(ProjectOperator, bpy.types.Operator):
    """Remove a known distance, or all that was measured. The scene gets its former place and size"""

    bl_idname = "heritage.clear_measurement"
    bl_label = "Clear Measurement"
    bl_options = {"REGISTER", "UNDO"}

    distance: int = IntProperty(name="Distance", description="Number of the distance to remove; 0: everything", min=0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove."""
        if not self.distance:
            measure(context.scene, Measurement())
            self.report({"INFO"}, "Nothing is measured now, and the unit is unknown.")
            return {"FINISHED"}
        before = current_measurement(project_of(context.scene.heritage))
        if self.distance > len(before.distances):
            raise SettingsError(f"There is no distance {self.distance}; {len(before.distances)} are stored.")
        kept = [one for number, one in enumerate(before.distances, 1) if number != self.distance]
        measure(context.scene, replace(before, distances=tuple(kept)))
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_measure, HERITAGE_OT_ground_from_plane, HERITAGE_OT_clear_measurement]
