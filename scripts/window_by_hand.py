"""Steps of the window test in which a curator edits objects by hand and measures the scene."""

from __future__ import annotations

import time

import numpy as np
from PIL import Image
from window_driver import PACKAGE, SCREEN_HEIGHT, Window, addon_module

RULER_COLOR = (255, 191, 51)
_OTHER_WORDS = f"""
import importlib
translations = importlib.import_module({PACKAGE + ".gaussian_heritage_addon.language.translations"!r})
texts = translations.language().texts
for name in dir(bpy.ops.heritage):
    kind = getattr(bpy.ops.heritage, name).get_rna_type()
    shown = bpy.app.translations.pgettext_iface(kind.name, kind.translation_context)
    if shown != texts.get(kind.name, shown):
        print(kind.name, end=" ")
"""
"""Prints the labels of our operators that Blender translates otherwise: its own translations come first."""
_REACH, _COLOR_TOLERANCE = 20, 60
"""Pixels around the middle of a ruler in which it must be seen, and the largest difference of its colour, of 255."""


def invoke(window: Window, operator: str, **options: object) -> None:
    """Start an operator that waits for the mouse, as its button in the sidebar does."""
    given = ", ".join(f"{name}={value!r}" for name, value in options.items())
    window.python(f"""
first = bpy.context.window_manager.windows[0]
for area in first.screen.areas:
    if area.type == "VIEW_3D":
        region = [region for region in area.regions if region.type == "WINDOW"][0]
        with bpy.context.temp_override(window=first, area=area, region=region):
            bpy.ops.heritage.{operator}("INVOKE_DEFAULT", {given})
""")
    time.sleep(2)


def frame_object(window: Window) -> tuple[tuple[float, float], float]:
    """Show an isolated object in Solid; return where its surface is seen near its middle, and its height, in pixels."""
    answer = window.python(f"""
import importlib
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
first = bpy.context.window_manager.windows[0]
bpy.context.scene.heritage.show = "OBJECTS"
one = next(obj for obj in bpy.context.scene.objects if obj.heritage.role == "OBJECT")
for area in first.screen.areas:
    if area.type == "VIEW_3D":
        region = [region for region in area.regions if region.type == "WINDOW"][0]
        view = area.spaces.active.region_3d
        with bpy.context.temp_override(window=first, area=area, region=region):
            area.spaces.active.shading.type = "SOLID"
            view.view_perspective = "PERSP"
            for obj in bpy.context.view_layer.objects: obj.select_set(obj == one)
            bpy.ops.view3d.view_axis(type="FRONT")
            bpy.ops.view3d.view_selected()
            one.select_set(False)
            view.view_distance *= 1.5
            view.update()
        threshold = np.float32(one.heritage.threshold)
        members = [one.matrix_world @ vertex.co for vertex, item in zip(one.data.vertices,
                   one.data.attributes["membership"].data) if item.value >= threshold]
        seen = np.array([location_3d_to_region_2d(region, view, member) for member in members])
        visible = importlib.import_module({PACKAGE + ".gaussian_heritage_addon.project.visible_splats"!r})
        sight, splats = visible.sight_of_viewport(region, view), visible.SplatsInView.of(bpy.context.scene)
        # Between the parts of an object, as of the back of a chair, there is nothing to click.
        order = np.round(seen[np.argsort(np.linalg.norm(seen - np.median(seen, axis=0), axis=1))])
        x, y = next(place for place in order if splats.seen(*sight.ray(*place)).point is not None)
        height = np.ptp(np.quantile(seen[:, 1], [.1, .9]))
        print(first.x + region.x + x, {SCREEN_HEIGHT} - first.y - region.y - y, height)
""")
    time.sleep(10)
    x, y, height = map(float, answer.split())
    return (x, y), height


def edit_by_hand(window: Window) -> None:
    """Select the object by a click in the view, take a part of it by a box, undo, take it again, and store it."""
    (x, y), height = frame_object(window)
    edits = addon_module("project.hand_edits")
    window.python("bpy.context.scene.heritage.active = -1")
    invoke(window, "pick_object", action="SELECT")
    window.click(x, y)
    listed = "bpy.data.objects[bpy.context.scene.heritage.active]"
    window.check("a click in the view selects the object", f"{listed}.heritage.role == 'OBJECT'")
    name = window.python(f"print({listed}.name)")
    obj = f"bpy.data.objects[{name!r}]"
    count = f"len({edits}.member_rows({obj}))"
    before = int(window.python(f"print({count})"))
    region = [x - height, y - 0.25 * height, x, y - 0.6 * height, x + height, y - height]
    invoke(window, "edit_region", action="TAKE", shape="BOX")
    window.drag(*region)
    window.check("a box in the view takes a part of the object", f"0 < {count} < {before}")
    window.scroll(12)
    window.shot("by_hand")
    window.scroll(-40)
    window.keys("ctrl+z")
    window.check("Ctrl+Z gives it back", f"{count} == {before} and not {obj}.heritage.is_edited")
    invoke(window, "edit_region", action="TAKE", shape="BOX")
    window.drag(*region)
    after = int(window.python(f"print({count})"))
    window.python("bpy.ops.heritage.store_edits()")
    state = f"{addon_module('jobs.job_runner')}.current()"
    window.wait_for(f"'edit' in {state}[0].command and not {state}[1].running", 120)
    window.wait_for(f"not {obj}.heritage.is_edited", 30)
    window.check("the edit is stored in the project", f"{state}[1].finished and {count} == {after} < {before}")


def _two_ends(window: Window) -> list[tuple[float, float]]:
    """Return positions on the screen, near the bottom and the top of the framed object, where a surface is seen."""
    answer = window.python(f"""
order = np.round(seen[np.argsort(seen[:, 1])])
for places in (order, order[::-1]):
    x, y = next(one for one in places[len(places) // 10:] if splats.seen(*sight.ray(*one)).point is not None)
    print(first.x + region.x + x, {SCREEN_HEIGHT} - first.y - region.y - y)
""")
    bottom, top = ((float(x), float(y)) for x, y in (line.split() for line in answer.splitlines()))
    return [bottom, top]


def _is_ruler_seen(window: Window, ends: list[tuple[float, float]]) -> bool:
    """Return whether the last picture `measured` has the ruler's colour between two positions on the screen."""
    with Image.open(window.work / "screenshots" / "measured.png") as picture:
        pixels = np.asarray(picture.convert("RGB"), np.float64)
    x, y = (round(sum(places) / 2) for places in zip(*ends, strict=True))
    around = pixels[y - _REACH : y + _REACH, x - _REACH : x + _REACH]
    return bool((np.abs(around - RULER_COLOR).max(axis=2) < _COLOR_TOLERANCE).sum() > _REACH)


def measure_scene(window: Window) -> None:
    """Pick the ends of a known distance and of a ruler in the view, and look at the panels, also in German."""
    frame_object(window)
    ends = _two_ends(window)
    invoke(window, "measure", action="DISTANCE", metres=0.3)
    for end in ends:
        window.click(*end)
    time.sleep(3)
    window.check("Blender measures in metres", "bpy.context.scene.unit_settings.system == 'METRIC'")
    unmeasured = "bpy.context.scene.unit_settings.system == 'NONE'"
    stored = "__import__('pathlib').Path(bpy.path.abspath(bpy.context.scene.heritage.project), 'measurement.json')"
    window.keys("ctrl+z")
    window.check("Ctrl+Z takes the measurement back, in the project too", f"{unmeasured} and not {stored}.exists()")
    window.keys("ctrl+shift+z")
    window.check("Ctrl+Shift+Z brings it again", f"not {unmeasured} and {stored}.exists()")
    frame_object(window)
    ends = _two_ends(window)
    invoke(window, "measure", action="RULER")
    for end in ends:
        window.click(*end)
    time.sleep(3)
    measuring = addon_module("project.measuring")
    # The view may have moved by a few pixels, and so may the ends.
    window.check(
        "the ruler shows the known distance", f"abs({measuring}.rulers(bpy.context.scene)[-1][1] - 0.3) < 0.06"
    )
    window.scroll(12)
    window.shot("measured")
    if not _is_ruler_seen(window, ends):
        window.fail("the ruler is not seen over the splats")
    print("  the ruler is seen over the splats", flush=True)
    window.python("bpy.context.preferences.view.language = 'de_DE'")
    time.sleep(5)
    window.shot("german")
    window.check(
        "German texts are shown", "bpy.app.translations.pgettext_iface('Known Distance') == 'Bekannter Abstand'"
    )
    others = window.python(_OTHER_WORDS)
    if others:
        window.fail(f"Blender has other words for {others}")
    print("  all buttons have the add-on's own words", flush=True)
    window.python("bpy.context.preferences.view.language = 'en_US'")
    time.sleep(3)
    window.scroll(-40)
