"""Typed Blender properties: the type is for the type checker, the property for Blender."""

from __future__ import annotations

from typing import TypeVar

_Class = TypeVar("_Class", bound=type)


def blender_properties(cls: _Class) -> _Class:
    """Give Blender the properties of `cls`, which is written like a dataclass, and return `cls`.

    Blender registers annotations, ``title: StringProperty(...)``, but a type checker rejects a call as a type. This
    class decorator accepts both::

        @blender_properties
        class HeritageObject(bpy.types.PropertyGroup):
            title: str = StringProperty(name="Title", update=_record_changed)

    Nothing else may be annotated in the body of such a class.
    """
    made = {name: vars(cls)[name] for name in cls.__annotations__}
    for name in made:
        delattr(cls, name)
    cls.__annotations__ = made
    return cls


def call_properties(cls: _Class) -> _Class:
    """Do the same for an operator of which no value of a call becomes the default of the next one."""
    blender_properties(cls)
    for made in cls.__annotations__.values():
        made.keywords["options"] = {"SKIP_SAVE"}
    return cls
