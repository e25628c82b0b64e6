"""Hostile .blend files: each case changes what an honest file stores, as somebody with bad intent would."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

Change = Callable[[Any, Path], None]
"""Changes the open file of the module ``bpy``; the path is the folder of the curator's own files."""


def splat_objects(bpy: Any) -> list[Any]:
    """Return the isolated objects of the scene."""
    return [obj for obj in bpy.context.scene.objects if obj.heritage.role == "OBJECT"]


def _set_each(**values: Any) -> Change:
    """Return a change that sets properties of every object as a file may store them."""

    def change(bpy: Any, precious: Path) -> None:
        for obj in splat_objects(bpy):
            for name, value in values.items():
                obj.heritage[name] = value.format(precious=precious) if isinstance(value, str) else value

    return change


def _set_project(value: str) -> Change:
    def change(bpy: Any, precious: Path) -> None:
        text = value.format(precious=precious)
        bpy.context.scene.heritage["project"] = text
        for obj in bpy.context.scene.objects:
            obj.heritage["project"] = text

    return change


def _set_names(bpy: Any, precious: Path) -> None:
    for obj in splat_objects(bpy):
        obj.name = "../../precious/x"
        obj.users_collection[0].name = str(precious)


def _set_photos(bpy: Any, precious: Path) -> None:
    for obj in bpy.context.scene.objects:
        if obj.type == "CAMERA":
            obj["heritage_photo"] = "../../precious/x.jpg"


def _set_counts(bpy: Any, precious: Path) -> None:
    for obj in bpy.context.scene.objects:
        obj["heritage_count"] = 2**30
        obj["heritage_object_id"] = "../../../precious/objects/vase"


def _add_script(bpy: Any, precious: Path) -> None:
    text = bpy.data.texts.new("run.py")
    text.write(f"open({str(precious / 'notes.txt')!r}, 'w').write('gone')")
    text.use_module = True
    obj = splat_objects(bpy)[0]
    driver = obj.driver_add("location", 0).driver
    driver.expression = f"open({str(precious / 'notes.txt')!r}, 'w').write('gone')"


BLENDS: tuple[tuple[str, Change], ...] = (
    *(
        (f".blend: object_id {value!r}", _set_each(object_id=value))
        for value in (
            "../../../precious/objects/vase", "..", "/", "", "{precious}/objects/vase", "C:\\Windows",
            "..\\..\\precious", "CON", "teapot/../../../../precious/objects/vase",
        )
    ),
    *(
        (f".blend: project {value!r}", _set_project(value))
        for value in ("{precious}", "{precious}/new/deep", "{precious}/notes.txt", "{precious}/project/objects", "")
    ),
    (".blend: names of objects and collections that lead out", _set_names),
    (".blend: photos of cameras that lead out", _set_photos),
    (".blend: counts and ids of collections", _set_counts),
    (".blend: levels out of all bounds", _set_each(n_levels=2**30, level=2**30 - 1, stored_level=2**30 - 1)),
    (".blend: a script and a driver", _add_script),
)  # fmt: skip
