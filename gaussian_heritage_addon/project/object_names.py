"""The name of an isolated object: one for the object, its collection, the list, the project and exported files.

A user renames the object or its collection in Blender, where two of a kind cannot have the same name. The project has
rules of its own (`new_name`). What both allow becomes the name.
"""

from __future__ import annotations

import re

import bpy

from ...engine.project.objects import new_name
from .object_state import HeritageState, all_objects, owners
from .stored_objects import seen

ID_KEY = "heritage_object_id"
"""Custom property of an object's own collection: the id of the object, empty while it is new."""
_NAME_KEY = "heritage_name"
"""Custom property of an object's own collection: the name that it was given."""
_NUMBERED = re.compile(r"(.+)\.\d{3,}")
"""A name to which Blender added a number."""


def own_collection(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the collection that was made for an object, not one that the user has added it to; None without one."""
    found = (one for one in obj.users_collection if one.get(ID_KEY) == obj.heritage.object_id)
    return next(found, None)


def give_name(obj: bpy.types.Object, name: str) -> None:
    """Call an object, and its own collection, `name`, or as Blender changes that where the name is in use."""
    state: HeritageState = obj.heritage_state
    former = obj.name
    # Blender may take a name away from another object that has it.
    if bpy.data.objects.get(name) in (None, obj):
        obj.name = name
    state.object_name, state.shown_name = name, obj.name
    collection = own_collection(obj)
    if collection is not None:
        if bpy.data.collections.get(name) in (None, collection):
            collection.name = name
        collection[_NAME_KEY] = collection.name
    for scene in obj.users_scene:
        if scene.heritage.active_name == former and scene.heritage.active_id == obj.heritage.object_id:
            scene.heritage.active_name = obj.name


def give_new_name(obj: bpy.types.Object, name: str) -> None:
    """Call an object that a user has just made `name`, or what projects and Blender both allow instead."""
    give_name(obj, _allowed(obj, name))


def was_renamed(one: bpy.types.ID) -> bool:
    """Return whether `one` is an isolated object, or the collection of one, with another name than it was given."""
    if isinstance(one, bpy.types.Object):
        state: HeritageState = one.heritage_state
        return one.heritage.role == "OBJECT" and not state.is_copy and one.name != state.shown_name
    return isinstance(one, bpy.types.Collection) and ID_KEY in one and one.get(_NAME_KEY) != one.name


def follow_renames() -> None:
    """Give each object that was renamed in Blender, or whose collection was, its new name everywhere in the file."""
    new = [obj for obj in all_objects() if not obj.heritage.object_id]
    for obj in (*owners().values(), *new):
        wanted = _renamed_to(obj)
        if wanted is not None:
            give_name(obj, wanted)


def _renamed_to(obj: bpy.types.Object) -> str | None:
    """Return the new name of an object; None where it was not renamed."""
    state: HeritageState = obj.heritage_state
    if not state.shown_name:
        # Made by a script.
        state.object_name = state.object_name or obj.name
        state.shown_name = obj.name
        return None
    collection = own_collection(obj)
    if obj.name != state.shown_name:
        return _allowed(obj, obj.name)
    if collection is not None and collection.name != collection.get(_NAME_KEY, collection.name):
        return _allowed(obj, collection.name)
    if collection is not None and collection.name != state.object_name not in bpy.data.collections:
        # Blender takes the name of an object back, but not that of its collection, which followed after the step.
        return state.object_name
    return None


def _allowed(obj: bpy.types.Object, name: str) -> str:
    """Return the name that an object gets, to which a user has set `name` in Blender."""
    others = {
        other.heritage_state.object_name
        for other in all_objects()
        if other != obj and other.heritage.project == obj.heritage.project
    }
    stored = {one.name for key, one in (seen(obj.heritage) or {}).items() if key != obj.heritage.object_id}
    taken = {*others, *stored, *(other.name for other in bpy.data.objects if other != obj)}
    numbered = _NUMBERED.fullmatch(name)
    return new_name(numbered[1] if numbered is not None and numbered[1] in taken else name, [*taken])
