"""Steps of the window test in which a curator selects objects, changes tools, and stops and continues jobs."""

from __future__ import annotations

import time

import numpy as np
from window_by_hand import frame_object, invoke
from window_driver import Window, addon_module

LAYER = "bpy.context.window_manager.windows[0].view_layer"
ROW = "bpy.context.scene.heritage.active"


def _is_selected(name: str) -> str:
    """Return the condition that an object is the row of the list, Blender's active object and the one selected."""
    return (
        f"bpy.data.objects[{ROW}].name == {LAYER}.objects.active.name == {name!r} and "
        f"[o.name for o in {LAYER}.objects if o.select_get()] == [{name!r}]"
    )


def select_objects(window: Window) -> None:
    """Select an object by click, box, list and Blender, close and open its eye, and look at it in Edit Mode."""
    (x, y), height = frame_object(window)
    name = window.python("print(next(o.name for o in bpy.context.scene.objects if o.heritage.role == 'OBJECT'))")
    obj = f"bpy.data.objects[{name!r}]"
    window.python("bpy.ops.ed.undo_push(message='frame')")
    window.check("nothing selected is no row of the list", f"{ROW} == -1")
    window.click(x, y)
    window.check("a click on visible splats selects the object, in Blender and in the list", _is_selected(name))
    window.shot("selected")
    window.keys("ctrl+z")
    window.check("Ctrl+Z undoes the selection", f"not {obj}.select_get()")
    window.python(f"for one in {LAYER}.objects: one.select_set(False)")
    side = height
    window.drag(x - side, y - side, x, y, x + side, y + side)
    window.check("a box around visible splats selects the object", f"{obj}.select_get()")
    window.check(
        "the active object is one of those in the box, and the row of the list",
        f"{LAYER}.objects.active.select_get() and bpy.data.objects[{ROW}] == {LAYER}.objects.active",
    )
    window.python(f"{ROW} = bpy.data.objects.find({name!r})")
    window.check("a row of the list selects the object in Blender", _is_selected(name))
    window.keys("h")
    window.check("H closes the eye of the list, also for renders", f"{obj}.heritage.hidden and {obj}.hide_render")
    window.keys("alt+h")
    window.check("Alt+H opens it again", f"not {obj}.heritage.hidden and {obj}.visible_get()")
    window.python(f"{ROW} = bpy.data.objects.find({name!r})")
    _look_in_edit_mode(window, (x, y), height, obj)
    _rename(window, name, obj)
    window.python(f"{ROW} = bpy.data.objects.find({name!r}); bpy.context.scene.heritage.show = 'SCENE'")
    time.sleep(3)
    window.settle()
    window.check("the row stays while the scene takes the place of its objects", f"bpy.data.objects[{ROW}] == {obj}")
    window.shot("row_in_scene")
    window.python("bpy.context.scene.heritage.show = 'OBJECTS'")
    window.settle()
    window.check("the object is selected again when it is shown again", _is_selected(name))


def _look_in_edit_mode(window: Window, place: tuple[float, float], height: float, obj: str) -> None:
    (x, y), half = place, 0.25 * height
    window.keys("Tab")
    window.keys("alt+a")
    flags = f"{addon_module('splats.edited_splats')}.vertex_flags({obj})"
    window.check("the mode is Edit Mode, in which nothing is selected", f"not {flags}[0].any()")
    view = addon_module("splats.splat_view")
    window.check("the object is drawn in Edit Mode", f"{obj}.data.name_full in {view}._state.edited")
    window.check("what is below the threshold is no dot", f"(~{flags}[1]).sum() == len({_rows(obj)})")
    window.drag(x - half, y - half, x, y, x + half, y + half)
    window.check("a box in Edit Mode selects Gaussians", f"0 < {flags}[0].sum() < len({flags}[0])")
    window.shot("edit_mode")
    window.keys("Tab")
    window.check("Tab leaves Edit Mode", f"{obj}.mode == 'OBJECT'")


def _rename(window: Window, name: str, obj: str) -> None:
    """Give the active object a name by F2, and undo it: its collection follows both times."""
    window.run("move", *map(round, window.region("VIEW_3D", "WINDOW")[:2] + np.array((500, 500))))
    window.keys("F2")
    window.run("type", "Krug")
    window.settle()
    names = "{o.name for o in bpy.data.objects} & {c.name for c in bpy.data.collections}"
    window.check("a new name is that of the object and of its collection", f"'Krug' in {names}")
    window.keys("ctrl+z")
    window.check("Ctrl+Z gives both their name back", f"{name!r} in {names} and {obj}.select_get()")


def _rows(obj: str) -> str:
    return f"{addon_module('project.hand_edits')}.member_rows({obj})"


def change_tools(window: Window) -> None:
    """Press *North*, then *Pick*: clicks belong to the last one, and Escape leaves it."""
    (x, y), _ = frame_object(window)
    running = "[o.bl_idname for o in bpy.context.window_manager.windows[0].modal_operators]"
    project = f"{addon_module('splats.properties')}.project_of(bpy.context.scene.heritage)"
    stored = f"{addon_module('project.measuring')}.current_measurement({project})"
    before = window.python(f"print({stored})")
    invoke(window, "measure", action="NORTH")
    invoke(window, "measure", action="RULER")
    window.run("move", round(x), round(y))
    window.settle()
    window.check("a new tool ends the former", f"{running} == ['HERITAGE_OT_measure']")
    window.shot("tool")
    window.click(x, y)
    window.keys("Escape")
    window.check("Escape leaves the tool", f"{running} == []")
    window.click(x, y)
    if window.python(f"print({stored})") != before:
        window.fail("clicks after Escape measure something")


def say_time_of_improving(window: Window) -> None:
    """Open the dialog of *Improve* as in a new session, and wait until it says how long the training takes."""
    times = addon_module("jobs.preset_times")
    dialog = addon_module("blender.open_dialog")
    drawn = f"open({str(window.work / 'calls.jsonl')!r}).read().count('improve_scene.draw')"
    window.python(f"{times}.stop(); {times}._known.clear()")
    invoke(window, "improve_scene", preset="standard")
    window.wait_for(f"{dialog}._region is not None", 30)
    before = int(window.python(f"print({drawn})"))
    window.wait_for(f"{times}._known", 300)
    window.wait_for(f"{drawn} > {before}", 10)
    window.shot("improve")
    print("  the dialog is drawn again when the time is known", flush=True)
    window.keys("Escape")
    window.check("the closed dialog is forgotten", f"{dialog}._region is None")


def continue_jobs(window: Window) -> None:
    """Start two jobs, stop both, and continue the first."""
    runner = addon_module("jobs.job_runner")
    stopped = f"{runner}.stopped(bpy.context.scene)"
    names = f"[job.command[-1] for _, job, _ in {stopped}]"
    count = int(window.python(f"print(len({stopped}))"))
    window.python("bpy.ops.heritage.isolate(prompt='vase')\nbpy.ops.heritage.isolate(prompt='teapot')")
    text = f"{addon_module('panels.scene_panel')}._running_text(*{runner}.current())"
    window.check("the first row says what waits", f"'+1 waiting: isolate teapot' in {text}")
    time.sleep(2)
    window.shot("waiting")
    for number in (1, 2):
        window.python("bpy.ops.heritage.cancel_job()")
        window.wait_for(f"len({stopped}) == {count + number}", 90)
        time.sleep(2)
    window.check("both stopped jobs can be continued", f"len({names}) >= 2")
    window.shot("stopped")
    window.python(f"bpy.ops.heritage.continue_job(number={count})")
    window.check("the first one runs again", f"{runner}.current()[1].running and len({stopped}) == {count + 1}")
    window.python("bpy.ops.heritage.cancel_job()")
    window.wait_for(f"len({stopped}) == {count + 2}", 90)
    window.python("bpy.ops.wm.read_homefile(use_empty=True)")
    time.sleep(4)
    window.check("an error of another file is not shown", f"not {stopped}")
