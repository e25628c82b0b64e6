"""Steps of the window test in which a project moves with its file, and renders show what the viewport shows."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence

import numpy as np
from places import ROOT
from window_driver import Window, addon_module

SIDE, LEAST_LIKENESS = 120, 28.0
"""Longest side of the renders in pixels: EEVEE is slow in software; and the goal of renders of splats in dB."""
ENGINES = ("CYCLES", "BLENDER_EEVEE")
PROJECT_OF = f"{addon_module('splats.properties')}.project_of"
ADD_BLACK_WORLD = """
world = bpy.data.worlds.new("black")
world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
bpy.context.scene.world = world
"""


def move_project(window: Window) -> None:
    """Move the file and its project to another folder, and open the file there."""
    place = window.work / "moved"
    place.mkdir()
    sizes = (
        "[(one.name, *(round(side, 4) for side in one.dimensions)) for one in bpy.data.objects "
        "if one.heritage.role != 'NONE']"
    )
    window.python(f"bpy.ops.wm.open_mainfile(filepath={str(window.work / 'museum.blend')!r})")
    before = window.python(f"print({sizes})")
    for name in ("museum.blend", "photos_heritage"):
        shutil.move(window.work / name, place / name)
    window.python(f"bpy.ops.wm.open_mainfile(filepath={str(place / 'museum.blend')!r})")
    window.wait_for(f"{PROJECT_OF}(bpy.context.scene.heritage).parent.name == 'moved'", 30)
    print("  a project that moved with its file is found again", flush=True)
    if window.python(f"print({sizes})") != before:
        window.fail("objects have another size where the file was moved")


def render_as_shown(window: Window) -> None:
    """Render an object in Cycles and EEVEE, also appended to a new file, beside what the viewport draws."""
    window.python((ROOT / "benchmarks" / "blender" / "in_window.py").read_text(encoding="utf-8"))
    name = window.python(
        f"""
scene = bpy.context.scene
scene.heritage.show = "OBJECTS"
bpy.ops.heritage.set_up_render()
found = [one for one in scene.objects if one.heritage.role == "OBJECT" and one.heritage.kind != "background"]
shown = max(found, key=lambda one: len(one.data.vertices))
for one in scene.objects:
    if one.heritage.role == "OBJECT": one.heritage.hidden = one != shown
bpy.ops.heritage.look_through_photo(longest_side={SIDE})
print(shown.name)
"""
        + ADD_BLACK_WORLD
    )
    _compare(window, "shown", name)
    _compare(window, "by_key", name, engines=("CYCLES",), render=_press_f12)
    file = window.work / "shown.blend"
    window.python(f"""
bpy.ops.wm.save_as_mainfile(filepath={str(file)!r}, copy=True)
camera, render = bpy.context.scene.camera.name, bpy.context.scene.render
names = ("resolution_x", "resolution_y", "pixel_aspect_x", "pixel_aspect_y")
size = [(one, getattr(render, one)) for one in names]
bpy.ops.wm.read_homefile()
""")
    window.wait_for("'Cube' in bpy.data.objects", 30)
    window.python(
        f"""
scene = bpy.context.scene
for one in list(bpy.data.objects): bpy.data.objects.remove(one)
for each in (camera, {name!r}):
    bpy.ops.wm.append(directory={str(file) + "/Object/"!r}, filename=each)
scene.camera = bpy.data.objects[camera]
for one, value in size: setattr(scene.render, one, value)
bpy.ops.heritage.set_up_render()
"""
        + ADD_BLACK_WORLD
    )
    _compare(window, "appended", name)


def _call_render(window: Window) -> None:
    """Render by the operator of F12."""
    window.python("bpy.ops.render.render()")


def _press_f12(window: Window) -> None:
    """Render by the key, with the pointer over the view, and close the window of the result."""
    left, top, width, height = window.region("VIEW_3D", "WINDOW")
    window.python("rendered = []\ndef note(*_): rendered.append(True)\nbpy.app.handlers.render_complete.append(note)")
    window.run("move", left + width // 3, top + height // 2)
    window.keys("F12")
    window.wait_for("rendered", 180)
    window.python("""
bpy.app.handlers.render_complete.remove(note)
for one in list(bpy.context.window_manager.windows)[1:]:
    with bpy.context.temp_override(window=one): bpy.ops.wm.window_close()
""")


def _compare(
    window: Window,
    place: str,
    name: str,
    *,
    engines: Sequence[str] = ENGINES,
    render: Callable[[Window], None] = _call_render,
) -> None:
    """Render in each engine, and compare with what the viewport draws of an object."""
    from PIL import Image

    seen = window.work / f"{place}.npy"
    window.python(f"drawn([bpy.data.objects[{name!r}]], 1.0, {str(seen)!r})")
    expected = np.clip(np.load(seen), 0, 1)
    if expected.max() < 0.1:
        window.fail("the viewport draws nothing of the object")
    pictures = [expected]
    for engine in engines:
        out = window.work / "screenshots" / f"render_{place}_{engine.lower()}.png"
        window.python(f"bpy.context.scene.render.engine = {engine!r}")
        render(window)
        window.python(f"bpy.data.images['Render Result'].save_render({str(out)!r})")
        found = np.asarray(Image.open(out).convert("RGB"), np.float32) / 255
        likeness = float(-10 * np.log10(np.mean((found - expected) ** 2)))
        if likeness < LEAST_LIKENESS:
            window.fail(f"a render by {engine} ({place}) is not what the viewport draws: {likeness:.1f} dB, see {out}")
        print(f"  a render by {engine}, {place}: {likeness:.1f} dB beside the viewport", flush=True)
        pictures.append(found)
    beside = Image.fromarray((np.concatenate(pictures, axis=1) * 255).astype(np.uint8))
    beside.save(window.work / "screenshots" / f"render_{place}.png")
