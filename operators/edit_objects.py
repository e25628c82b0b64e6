"""Edit isolated objects by hand: assign a selection, split, merge, delete, remove floaters, store it in the project."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty
from numpy.typing import NDArray

from ..engine.core.errors import ObjectError
from ..engine.core.words import split_list
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties, call_properties
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.project.hand_edits import (
    add_rows,
    delete_object,
    merge_objects,
    new_object,
    object_mode,
    take_vertices,
    whole_of,
)
from ..gaussian_heritage_addon.project.not_stored import store_arguments
from ..gaussian_heritage_addon.splats.floaters import find_floaters
from ..gaussian_heritage_addon.splats.properties import apply_blending, apply_visibility, project_of, scene_count
from ..gaussian_heritage_addon.splats.selection import heritage_objects, set_active_object
from ..gaussian_heritage_addon.splats.splats import SplatScene
from .project_operator import ProjectOperator, listed_object


class _ObjectOperator(ProjectOperator, bpy.types.Operator):
    """An operator for isolated objects of a project."""

    bl_options = {"REGISTER", "UNDO"}


def _selected_vertices(obj: bpy.types.Object) -> NDArray[np.intp]:
    """Return the vertices that are selected in Edit Mode, or were when it was left."""
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    selected = np.zeros(len(obj.data.vertices), bool)
    obj.data.vertices.foreach_get("select", selected)
    return np.flatnonzero(selected)


def _edited_splats(context: bpy.types.Context) -> bpy.types.Object:
    """Return the splats that are in Edit Mode, or else the active splats."""
    obj = context.view_layer.objects.active
    if obj is None or not SplatScene.is_splats(obj) or obj.heritage.role == "NONE":
        raise ObjectError("Select splats of the scene or of an object, and Gaussians of them in Edit Mode (Tab).")
    return obj


def _selection(context: bpy.types.Context) -> tuple[bpy.types.Object, NDArray[np.intp], NDArray[np.int32]]:
    """Return the splats with a selection, its vertices, and their rows in the scene of the project."""
    source = _edited_splats(context)
    vertices = _selected_vertices(source)
    if not len(vertices):
        raise ObjectError(f"Nothing is selected in {source.name}. Select Gaussians in Edit Mode (Tab).")
    return source, vertices, SplatScene.of(source).index(scene_count(source))[vertices]


@blender_properties
class HERITAGE_OT_assign_to_object(_ObjectOperator):
    """Make the Gaussians selected in Edit Mode part of the object selected in the list. The scene keeps its own copy"""

    bl_idname = "heritage.assign_to_object"
    bl_label = "Assign to Object"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the selection."""
        target = listed_object(context.scene)
        source, vertices, rows = _selection(context)
        if source == target:
            raise ObjectError(f"The selection is part of {target.name} already. Select another object in the list.")
        with object_mode():
            added = add_rows(target, rows, whole_of(target, context.scene))
            if source.heritage.role == "OBJECT":
                take_vertices(source, vertices)
        self.report({"INFO"}, f"{added:,} Gaussians were added to {target.name}.")
        return {"FINISHED"}


@blender_properties
class HERITAGE_OT_take_selection(_ObjectOperator):
    """Take the Gaussians selected in Edit Mode away from their object. They stay in the scene"""

    bl_idname = "heritage.take_selection"
    bl_label = "Take from Object"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the selection."""
        source, vertices, _ = _selection(context)
        if source.heritage.role != "OBJECT":
            raise ObjectError("Nothing can be taken from the scene itself. Select an isolated object.")
        with object_mode():
            taken = take_vertices(source, vertices)
        self.report({"INFO"}, f"{taken:,} Gaussians were taken from {source.name}.")
        return {"FINISHED"}


@call_properties
class HERITAGE_OT_split_object(_ObjectOperator):
    """Make a new object of the Gaussians selected in Edit Mode, and take them from the object that they are part of"""

    bl_idname = "heritage.split_object"
    bl_label = "Split Object"

    name: str = StringProperty(name="Name", description="Name of the new object; empty: that of the old")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Split."""
        source, vertices, _ = _selection(context)
        with object_mode():
            if source.heritage.role == "OBJECT":
                take_vertices(source, vertices)
            title = source.name if source.heritage.role == "OBJECT" else "object"
            splats = new_object(context.scene, self.name.strip() or title, vertices, source)
            _finish_new(context, splats)
        self.report({"INFO"}, f"{splats.name} has {len(vertices):,} Gaussians.")
        return {"FINISHED"}


def _finish_new(context: bpy.types.Context, splats: SplatScene) -> None:
    apply_blending(context.scene)
    apply_visibility(context.scene)
    set_active_object(context.scene, splats.object)


@call_properties
class HERITAGE_OT_merge_objects(_ObjectOperator):
    """Merge all selected isolated objects into the one that is selected in the list"""

    bl_idname = "heritage.merge_objects"
    bl_label = "Merge Objects"

    names: str = StringProperty(
        name="Objects",
        description='For scripts: names of the objects to merge in, separated by ";"; empty: the selected ones',
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Merge."""
        target = listed_object(context.scene)
        others = [obj for obj in self._others(context) if obj != target]
        if not others:
            raise ObjectError(f"Select the objects that become part of {target.name} as well (Shift-click).")
        names = ", ".join(obj.name for obj in others)
        with object_mode():
            merge_objects(target, others, context.scene)
        set_active_object(context.scene, target)
        self.report({"INFO"}, f"{names} became part of {target.name}.")
        return {"FINISHED"}

    def _others(self, context: bpy.types.Context) -> Sequence[bpy.types.Object]:
        isolated = heritage_objects(context.scene, "OBJECT")
        if not self.names:
            return [obj for obj in isolated if obj.select_get()]
        wanted = split_list(self.names)
        by_name = {obj.name: obj for obj in isolated}
        if missing := [name for name in wanted if name not in by_name]:
            raise ObjectError(f"No isolated object is called {missing[0]!r}.")
        return [by_name[name] for name in wanted]


class HERITAGE_OT_delete_object(_ObjectOperator):
    """Delete the object selected in the list. Ctrl+Z brings it back; stored, it goes to the trash of the project"""

    bl_idname = "heritage.delete_object"
    bl_label = "Delete Object"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete."""
        obj = listed_object(context.scene)
        name = obj.name
        with object_mode():
            delete_object(obj)
        self.report({"INFO"}, f"{name} was deleted. Store moves it to the project's trash as well.")
        return {"FINISHED"}


@blender_properties
class HERITAGE_OT_floaters(_ObjectOperator):
    """Show what floats around the object, isolated or faint Gaussians, as a selection in Edit Mode; or remove it"""

    bl_idname = "heritage.floaters"
    bl_label = "Floaters"

    remove: bool = BoolProperty(
        name="Remove", description="Take them from the object instead of showing them", options={"SKIP_SAVE"}
    )
    min_neighbours: int = IntProperty(
        name="Neighbours",
        description="A Gaussian with fewer others near it is isolated; most have about 20",
        default=3,
        min=0,
        max=20,
    )
    min_opacity: float = FloatProperty(
        name="Opacity",
        description="A Gaussian with a lower opacity is faint",
        default=0.02,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show or remove."""
        obj = listed_object(context.scene)
        if obj.mode == "EDIT":
            bpy.ops.object.mode_set(mode="OBJECT")
        splats = SplatScene.of(obj)
        shown = np.flatnonzero(splats.shown)
        gaussians = splats.local_gaussians()[shown]
        found = shown[find_floaters(gaussians, min_neighbours=self.min_neighbours, min_opacity=self.min_opacity)]
        if not len(found):
            self.report({"INFO"}, f"{obj.name} has no floaters.")
            return {"CANCELLED"}
        if self.remove:
            take_vertices(obj, found)
            self.report({"INFO"}, f"{len(found):,} floaters were taken from {obj.name}.")
            return {"FINISHED"}
        _show_selected(context, obj, found)
        self.report({"INFO"}, f"{len(found):,} of {len(shown):,} Gaussians of {obj.name} are floaters.")
        return {"FINISHED"}


def _show_selected(context: bpy.types.Context, obj: bpy.types.Object, vertices: NDArray[np.intp]) -> None:
    """Select `vertices` of an object in Edit Mode, where Blender's own tools change the selection."""
    context.scene.heritage.show = "OBJECTS"
    for other in context.view_layer.objects:
        other.select_set(other == obj)
    context.view_layer.objects.active = obj
    selected = np.zeros(len(obj.data.vertices), bool)
    selected[vertices] = True
    obj.data.vertices.foreach_set("select", selected)
    bpy.ops.object.mode_set(mode="EDIT")


class HERITAGE_OT_store_edits(_ObjectOperator):
    """Store in the project what Blender shows otherwise. What this replaces or deletes goes to the project's trash"""

    bl_idname = "heritage.store_edits"
    bl_label = "Store Edits"
    bl_options = {"REGISTER"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        project = project_of(context.scene.heritage)
        with object_mode():
            arguments = store_arguments(context.scene)
        if not arguments:
            self.report({"INFO"}, "Stored.")
            return {"FINISHED"}
        state = job_runner.start("segment", project, "edit", str(project), *arguments)
        self.report({"INFO"}, "Storing the edits; see the Heritage panel." if state is None else state.message)
        return {"FINISHED"}


CLASSES = [
    HERITAGE_OT_assign_to_object,
    HERITAGE_OT_take_selection,
    HERITAGE_OT_split_object,
    HERITAGE_OT_merge_objects,
    HERITAGE_OT_delete_object,
    HERITAGE_OT_floaters,
    HERITAGE_OT_store_edits,
]
