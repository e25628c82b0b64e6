"""Typed Blender properties become the annotations that Blender registers."""

from __future__ import annotations

import importlib

from .conftest import PACKAGE

typed_properties = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.blender.typed_properties")


def string_property(**options: object) -> tuple[str, dict[str, object]]:
    """Stand in for ``bpy.props.StringProperty``."""
    return "string", options


@typed_properties.blender_properties
class Example:
    """A class like a property group."""

    title: str = string_property(name="Title", options={"SKIP_SAVE"})  # type: ignore[assignment]
    kind = "example"


def test_property_becomes_the_annotation_that_blender_reads() -> None:
    assert Example.__annotations__ == {"title": ("string", {"name": "Title", "options": {"SKIP_SAVE"}})}
    assert not hasattr(Example, "title") and Example.kind == "example"
