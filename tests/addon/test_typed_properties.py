"""Typed Blender properties become the annotations that Blender registers."""

from __future__ import annotations

import importlib
from typing import Annotated

from .conftest import PACKAGE

typed_properties = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.blender.typed_properties")


def string_property(**options: object) -> tuple[str, dict[str, object]]:
    """Stand in for ``bpy.props.StringProperty``."""
    return "string", options


@typed_properties.blender_properties
class Example:
    """A class like a property group."""

    title: Annotated[str, string_property(name="Title", options={"SKIP_SAVE"})]
    count: int = 0


def test_property_takes_the_place_of_its_annotation() -> None:
    assert Example.__annotations__["title"] == ("string", {"name": "Title", "options": {"SKIP_SAVE"}})


def test_other_annotations_are_kept() -> None:
    assert Example.__annotations__["count"] is int and Example.count == 0
