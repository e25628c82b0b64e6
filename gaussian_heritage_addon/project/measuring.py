"""Measurements of a project, as the panel shows them, and picked points of Blender's world as those of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...engine.core.arrays import Float64
from ...engine.core.errors import FormatError, HeritageError, ObjectError
from ...engine.core.files import read_after_change
from ...engine.scene import Measurement, Point, load_measurement, save_measurement
from ..blender.world_placement import drawn_matrix
from ..splats.properties import project_of
from ..splats.selection import heritage_objects
from .moved_views import follow_move
from .placement import (
    GROUND_KEY,
    RULER_KEY,
    apply_measurement,
    is_metric,
    placement_properties,
    scene_placement,
    shows_project,
)
from .project_history import remember_measurement
from .scene_file import whole_scene


@read_after_change("measurement.json", "cameras/cameras.json")
def current_measurement(project: Path) -> Measurement:
    """Return what was measured of a project; panels call this often, so the file is read again only after a change.

    Raises
    ------
    FormatError
        As `load_measurement`.
    """
    return load_measurement(project)


def measure(scene: bpy.types.Scene, measurement: Measurement) -> None:
    """Store `measurement` in the project of `scene`, and place it accordingly in all scenes of the file that show it.

    Raises
    ------
    HeritageError
        When it cannot be used or stored.
    """
    project = project_of(scene.heritage)
    try:
        before = load_measurement(project)
    except FormatError:
        # A damaged file is replaced, and does not come back.
        before = Measurement()
    former = {
        one: scene_placement(whole)
        for one in bpy.data.scenes
        if shows_project(one, project)
        for whole in heritage_objects(one, "SCENE")[:1]
    }
    # In every scene of the file: objects that stayed behind would show other lengths than those that are stored.
    save_measurement(project, measurement)
    done: list[bpy.types.Scene] = []
    try:
        for one in bpy.data.scenes:
            apply_measurement(one, project, measurement)
            done.append(one)
    except HeritageError:
        for one in done:
            apply_measurement(one, project, before)
        save_measurement(project, before)
        raise
    scenes = [one for one in bpy.data.scenes if shows_project(one, project)]
    remember_measurement(scenes, before, measurement)
    for one in scenes:
        if one in former:
            follow_move(one, measurement.measured_from_world @ np.linalg.inv(former[one]))
        for ruler, length in rulers(one):
            ruler.name = length_text(one, length)


def scene_points(scene: bpy.types.Scene, points: Sequence[Float64]) -> list[Point]:
    """Return points [3] of Blender's world as positions in the normalised world of the project.

    Raises
    ------
    ObjectError
        When the whole scene was not imported, or is flattened.
    """
    whole = whole_scene(scene, project_of(scene.heritage))
    if whole is None:
        raise ObjectError("The whole scene is not in this file. Open the project again.")
    inverse = np.linalg.inv(scene_placement(whole))
    moved = [inverse[:3, :3] @ point + inverse[:3, 3] for point in points]
    return [(float(x), float(y), float(z)) for x, y, z in moved]


def length_text(scene: bpy.types.Scene, length: float) -> str:
    """Return a length of Blender's world as text, in metres where the scale is known."""
    if not any(is_metric(obj) for obj in _measured_splats(scene)):
        return f"{length:.4g} units"
    return f"{length:.3f} m" if length >= 1 else f"{length * 100:.1f} cm"


def _measured_splats(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the splats that say what a length of `scene` is: those of its project, or all where it has none."""
    splats = heritage_objects(scene)
    if not scene.heritage.project:
        return splats
    project = project_of(scene.heritage)
    return [obj for obj in splats if obj.heritage.project and project_of(obj.heritage) == project]


def follow_measurements(scene: bpy.types.Scene, obj: bpy.types.Object, key: str = GROUND_KEY) -> None:
    """Let `obj`, which stands where it should, be moved with the splats of `scene` whenever these are measured.

    An object that is linked from another file cannot be moved, and stays.
    """
    if obj.library is not None:
        return
    obj[key] = True
    for splats in _measured_splats(scene)[:1]:
        for name, value in placement_properties(splats).items():
            obj[name] = value


def add_ruler(scene: bpy.types.Scene, first: Float64, second: Float64) -> bpy.types.Object:
    """Add a line between two points [3] of Blender's world, named after its length."""
    mesh = bpy.data.meshes.new("Ruler")
    mesh.from_pydata([(0.0, 0.0, 0.0), (second - first).tolist()], [(0, 1)], [])
    ruler = bpy.data.objects.new(length_text(scene, float(np.linalg.norm(second - first))), mesh)
    follow_measurements(scene, ruler, RULER_KEY)
    # `ruler_view` draws it, with its name, over the splats.
    ruler.show_in_front = True
    ruler.display_type, ruler.hide_render = "WIRE", True
    ruler.location = first
    scene.collection.objects.link(ruler)
    return ruler


def rulers(scene: bpy.types.Scene) -> list[tuple[bpy.types.Object, float]]:
    """Return the rulers of `scene`, with their lengths in units of Blender's world."""
    found = []
    for obj in scene.objects:
        if obj.type == "MESH" and RULER_KEY in obj and len(obj.data.vertices) == 2:
            placement = drawn_matrix(obj)
            first, second = (placement @ vertex.co for vertex in obj.data.vertices)
            found.append((obj, float((second - first).length)))
    return found
