"""A Blender window without a screen, driven from outside, for the steps of the window test."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

from places import ROOT

PACKAGE = "bl_ext.user_default.gaussian_heritage"
SCREEN_HEIGHT = 1000
_SCRIPT = ROOT / "scripts" / "window" / "window.sh"


def addon_module(name: str) -> str:
    """Return the expression that is a module of the add-on in the window."""
    return f"__import__('{PACKAGE}.gaussian_heritage_addon.{name}', fromlist=['x'])"


class Failed(Exception):
    """Something that a curator would see is not as it should be."""


class Window:
    """A Blender window. Positions are pixels of the screen, from its upper left corner."""

    def __init__(self, work: Path, root: Path, sees: list[Path]) -> None:
        self.work = work
        self._shots = work / "screenshots"
        self._environment = {
            **os.environ, "BLENDER_WINDOW_ROOT": str(root), "BLENDER_WINDOW_WORK": str(work),
            "BLENDER_WINDOW_SEES": ":".join(map(str, sees)),
        }  # fmt: skip

    def run(self, *words: object, text: str | None = None) -> str:
        """Run a command of window.sh and return what it prints."""
        command = ["bash", str(_SCRIPT), *map(str, words)]
        done = subprocess.run(
            command, env=self._environment, input=text, capture_output=True, text=True, check=False, timeout=1800
        )
        if done.returncode:
            raise Failed(f"{' '.join(command)} failed: {done.stdout[-500:]}{done.stderr[-500:]}")
        return done.stdout

    def start(self, how: str = "start") -> None:
        """Start Blender, and the screen unless `how` is "again", and wait until it answers."""
        if how == "start":
            self.stop()
        # Programs started in a chroot keep the pipes of `run` open.
        subprocess.Popen(
            ["bash", str(_SCRIPT), how], env=self._environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        time.sleep(8)
        self.wait_for("True", 60)

    def stop(self) -> None:
        """End Blender."""
        subprocess.run(["bash", str(_SCRIPT), "stop"], env=self._environment, capture_output=True, check=False)

    def python(self, code: str, seconds: int = 300) -> str:
        """Run Python in the window and return what it prints."""
        answer = self.run("py", seconds, text=code)
        if "Traceback" in answer:
            raise Failed(answer)
        return answer.strip()

    def wait_for(self, condition: str, seconds: float) -> None:
        """Wait until a Python expression is true in the window."""
        end = time.monotonic() + seconds
        while self.python(f"print(bool({condition}))") != "True":
            if time.monotonic() > end:
                raise Failed(f"not true within {seconds:.0f} s: {condition}")
            time.sleep(1.0)

    def click(self, x: float, y: float) -> None:
        """Press the left mouse button at a position."""
        self.run("click", round(x), round(y))
        time.sleep(1.5)
        self.settle()

    def keys(self, *keys: str) -> None:
        """Press keys, one after the other, and wait until Blender has handled them."""
        for key in keys:
            self.run("key", key)
            time.sleep(3)
            self.settle()

    def drag(self, *positions: float) -> None:
        """Press the left mouse button at the first position, move over the others, and release it at the last."""
        self.run("path", *map(round, positions))
        time.sleep(4)
        self.settle()

    def settle(self) -> None:
        """Wait until Blender has handled what was pressed, and drawn it: on a busy computer this takes seconds."""
        for _ in range(2):
            self.python("print()")

    def shot(self, name: str) -> None:
        """Save the screen as ``screenshots/<name>.png``."""
        self._shots.mkdir(exist_ok=True)
        self.run("shot", self._shots / f"{name}.png")

    def region(self, area: str, region: str) -> tuple[int, int, int, int]:
        """Return left, top, width and height of a region on the screen."""
        code = f"""
for window in bpy.context.window_manager.windows:
    for area in window.screen.areas:
        for region in area.regions:
            if (area.type, region.type) == {(area, region)!r} and region.height > 1:
                print(window.x + region.x, {SCREEN_HEIGHT} - window.y - region.y - region.height, end=" ")
                print(region.width, region.height)
"""
        found = self.python(code).splitlines()
        if not found:
            raise Failed(f"there is no region {region} of a {area}")
        left, top, width, height = map(int, found[0].split())
        return left, top, width, height

    def show_tab(self) -> None:
        """Open the sidebar at the tab *Heritage*."""
        for code in ("area.spaces.active.show_region_ui = True", "show(area)"):
            self.python(f"""
def show(area):
    for region in area.regions:
        if region.type == "UI":
            region.active_panel_category = "Heritage"
            region.tag_redraw()
for area in bpy.context.window_manager.windows[0].screen.areas:
    if area.type == "VIEW_3D": {code}
""")
            time.sleep(2)
        self.settle()

    def new_file(self) -> None:
        """Begin a new file of Blender, with our tab in sight."""
        self.python("bpy.ops.wm.read_homefile()")
        self.wait_for("'Cube' in bpy.data.objects", 30)
        self.show_tab()

    def newest(self) -> tuple[int, int, int, int]:
        """Return left, top, right and bottom of the newest window of Blender on the screen."""
        code = f"w = bpy.context.window_manager.windows[-1]; y = {SCREEN_HEIGHT} - w.y; "
        answer = self.python(code + "print(w.x, y - w.height, w.x + w.width, y)")
        left, top, right, bottom = map(int, answer.split())
        return left, top, right, bottom

    def press(self, right: float, below: float) -> None:
        """Click in the sidebar, `right` of its width from its left, `below` pixels under its top."""
        left, top, width, _ = self.region("VIEW_3D", "UI")
        self.click(left + right * width, top + below)

    def scroll(self, steps: int) -> None:
        """Turn the mouse wheel over the sidebar, downwards for positive `steps`."""
        left, top, width, height = self.region("VIEW_3D", "UI")
        self.run("wheel", round(left + 0.4 * width), round(top + 0.6 * height), steps)
        time.sleep(2)
        self.settle()

    def fail(self, what: str) -> None:
        """Raise `Failed`."""
        raise Failed(what)

    def check(self, what: str, condition: str) -> None:
        """Raise `Failed` unless a Python expression is true in the window."""
        if self.python(f"print(bool({condition}))") != "True":
            raise Failed(f"{what}: {condition}")
        print(f"  {what}", flush=True)
