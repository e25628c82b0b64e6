"""Steps of the window test: a first picture of a scene, and a word that is answered by pictures."""

from __future__ import annotations

from pathlib import Path

from window_driver import Window, addon_module

WORD = "ciborium"
"""A word of museums that the vocabulary does not know: a goblet with a lid."""
JOB = f"{addon_module('jobs.job_runner')}.current()"
ISOLATED = "[one.name for one in bpy.context.scene.objects if one.heritage.role == 'OBJECT']"
PROMPT_BELOW, ISOLATE_BELOW, LEARN_BELOW = 390, 416, 490
"""The field and buttons of the panel *Objects* of a project without objects, in pixels under the top of the sidebar."""
TURNS, OFFER_BELOW, ACCEPT_BELOW = 12, 301, 793
"""*Know Any Word* and the last *This One* after as many turns of the wheel, also in pixels."""
FOUND_SECONDS = 900
"""Longest time of a first word; the machine may be busy."""


def see_first_picture(window: Window, photos: Path) -> None:
    """Import photos into a new file until the tab shows the scene, whose cameras are still being estimated."""
    window.new_file()
    window.python(f"bpy.ops.heritage.import_photo_folder(directory={str(photos)!r}, preset='preview')")
    window.wait_for(f"{JOB}[1].preview and {JOB}[1].stage == 'cameras'", FOUND_SECONDS)
    window.settle()
    window.shot("first_picture")
    print("  the scene is seen while its cameras are estimated", flush=True)
    window.python("bpy.ops.heritage.cancel_job()")
    window.wait_for(f"not {JOB}[1].running", 120)


def accept_a_picture(window: Window, project: Path) -> None:
    """Ask for a word that nobody knows, look at the model that is offered, and name the object of a picture by it."""
    _ask(window, project)
    window.check("a word that is not known is refused", f"{JOB}[1].error_type == 'PromptError' and not {ISOLATED}")
    window.scroll(TURNS)
    window.shot("refused_word")
    window.press(0.4, OFFER_BELOW)
    window.shot("know_any_word")
    window.keys("Escape")
    _rest_and_press(window, 0.8, ACCEPT_BELOW)
    window.wait_for(f"{ISOLATED} == [{WORD!r}]", 120)
    print("  the object of the picture has the word as its name", flush=True)


def _ask(window: Window, project: Path) -> None:
    """Open a project in a new file, let it learn, and type and isolate the word."""
    window.new_file()
    window.python(f"bpy.ops.heritage.open_project(directory={str(project)!r})")
    window.settle()
    window.show_tab()
    window.press(0.4, LEARN_BELOW)
    window.press(0.4, PROMPT_BELOW)
    window.run("type", WORD)
    _rest_and_press(window, 0.4, ISOLATE_BELOW)
    window.wait_for(f"{JOB}[0].kind == 'segment' and {JOB}[0].subject.startswith({str(project)!r})", 60)
    window.wait_for(f"not {JOB}[1].running", FOUND_SECONDS)
    window.settle()


def _rest_and_press(window: Window, right: float, below: float) -> None:
    """Press in the sidebar after the pointer rested there: a field or dialog that had it takes what comes first."""
    left, top, width, _ = window.region("VIEW_3D", "UI")
    for x, y in ((left - 400, top + 300), (left + right * width, top + below)):
        window.run("move", round(x), round(y))
        window.settle()
    window.press(right, below)
