"""The textured meshes that stand beside splats, as children of them: which they are, and when they are shown."""

from __future__ import annotations

import bpy

_MESH_KEY = "heritage_mesh_of"
"""Custom property of a mesh: the id of its object in the project."""


def mark_mesh(mesh: bpy.types.Object, obj: bpy.types.Object) -> None:
    """Make `mesh` the one of the splats `obj`, which it follows from now on."""
    mesh.parent = obj
    mesh[_MESH_KEY] = obj.heritage.object_id


def meshes_of(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the meshes that were made of the splats `obj` and still follow them."""
    return [one for one in obj.children if one.get(_MESH_KEY) == obj.heritage.object_id]


def show_meshes(obj: bpy.types.Object, layer: bpy.types.ViewLayer, *, replaced: bool) -> None:
    """Show the meshes of the splats `obj`, unless others are shown in the place of these. Their eyes are the user's."""
    for mesh in meshes_of(obj):
        mesh.hide_viewport = replaced
        mesh.hide_render = replaced or mesh.hide_get(view_layer=layer)


def hide_meshes(obj: bpy.types.Object, layer: bpy.types.ViewLayer, *, hidden: bool) -> None:
    """Close or open the eyes of the meshes of the splats `obj`."""
    for mesh in [one for one in meshes_of(obj) if layer.objects.get(one.name) == one]:
        mesh.hide_set(hidden, view_layer=layer)


def remove_meshes(obj: bpy.types.Object) -> None:
    """Remove the meshes of the splats `obj`, with data that nothing else uses."""
    for mesh in meshes_of(obj):
        data = mesh.data
        bpy.data.objects.remove(mesh)
        if data.users == 0:
            bpy.data.meshes.remove(data)
