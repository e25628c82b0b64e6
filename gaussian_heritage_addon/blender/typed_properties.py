"""Typed Blender properties: one annotation gives the type checker a type and Blender a property."""

from __future__ import annotations

import inspect
from typing import Any, TypeVar

_Class = TypeVar("_Class", bound=type)


def blender_properties(cls: _Class) -> _Class:
    """Replace the annotations ``Annotated[type, property]`` of `cls` by their properties, and return `cls`.

    Blender registers the usual ``title: StringProperty(...)``, but a type checker rejects a call as a type. This class
    decorator accepts both::

        @blender_properties
        class HeritageObject(bpy.types.PropertyGroup):
            title: Annotated[str, StringProperty(name="Title", update=_record_changed)]

    The module must contain ``from __future__ import annotations``. The annotations are evaluated in its globals, so
    functions such as ``_record_changed`` must be defined above the class.
    """
    cls.__annotations__ = inspect.get_annotations(cls, eval_str=True, locals={"Annotated": _PropertyOf})
    return cls


def call_properties(cls: _Class) -> _Class:
    """Do the same for an operator of which no value of a call becomes the default of the next one."""
    blender_properties(cls)
    for made in cls.__annotations__.values():
        made.keywords["options"] = {"SKIP_SAVE"}
    return cls


class _PropertyOf:
    """Takes the place of ``typing.Annotated``, which would keep each property in a cache.

    With these references, Blender 4.5 as a Python module (bpy) hangs when the interpreter exits.
    """

    def __class_getitem__(cls, arguments: tuple[Any, Any]) -> Any:
        return arguments[1]
