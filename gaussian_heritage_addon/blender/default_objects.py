"""The cube and the light of a new Blender file, which stand in the middle of an imported scene."""

from __future__ import annotations

import bpy
from mathutils import Matrix

from .world_placement import drawn_matrix

_CUBE_CORNERS = {(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)}
_LIGHT_LOCATION = (4.0762, 1.0055, 5.9039)
_TOLERANCE = 1e-3


def untouched_defaults(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the cube and the light of Blender's new file, as far as `scene` has them and nobody changed them."""
    return [obj for obj in scene.objects if _is_default_cube(obj) or _is_default_light(obj)]


def hide_untouched_defaults(scene: bpy.types.Scene) -> None:
    """Hide them in views and renders of `scene`: the cube would hide what is imported. Alt+H shows it again."""
    for obj in untouched_defaults(scene):
        obj.hide_render = True
        for layer in scene.view_layers:
            if obj.name in layer.objects:
                obj.hide_set(True, view_layer=layer)


def _is_default_cube(obj: bpy.types.Object) -> bool:
    if obj.name != "Cube" or obj.type != "MESH" or obj.modifiers or obj.children:
        return False
    if drawn_matrix(obj) != Matrix():
        return False
    vertices = obj.data.vertices
    return len(vertices) == 8 and {tuple(vertex.co) for vertex in vertices} == _CUBE_CORNERS


def _is_default_light(obj: bpy.types.Object) -> bool:
    if obj.name != "Light" or obj.type != "LIGHT" or obj.children:
        return False
    place = drawn_matrix(obj).translation
    return obj.data.type == "POINT" and all(
        abs(a - b) < _TOLERANCE for a, b in zip(place, _LIGHT_LOCATION, strict=True)
    )
