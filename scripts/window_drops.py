"""Step of the window test in which files are dropped on the view, as from a file manager."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from window_driver import Window


def drop_files(window: Window, ply: Path, photos: Sequence[Path], video: Path) -> None:
    """Drop a Gaussian PLY and import it; drop photos and a video, and look at the dialogs that they open."""
    meshes = "[o.name for o in bpy.data.objects if o.type == 'MESH']"
    before = int(window.python(f"print(len({meshes}))"))
    _drop(window, "g", "HERITAGE_OT_import_gaussian_ply.invoke", ply)
    window.shot("dropped_ply")
    window.run("key", "Return")
    window.wait_for(f"len({meshes}) == {before + 1}", 60)
    print("  a dropped Gaussian PLY is imported", flush=True)
    window.run("key", "ctrl+z")
    window.wait_for(f"len({meshes}) == {before}", 60)
    for name, files in (("photos", photos), ("video", [video])):
        _drop(window, "i", "HERITAGE_OT_import_photo_folder.invoke", *files)
        window.shot(f"dropped_{name}")
        window.keys("Escape")
        print(f"  dropped {name} open the dialog of the import", flush=True)


def _drop(window: Window, key: str, call: str, *files: Path) -> None:
    """Drop files on the view, choose our entry of the menu that Blender shows by its key, and wait for the call."""
    log = window.work / "calls.jsonl"
    before = log.read_text().count(f'"{call}"') if log.exists() else 0
    left, top, width, height = window.region("VIEW_3D", "WINDOW")
    window.run("drop", round(left + 0.4 * width), round(top + 0.5 * height), *files)
    window.settle()
    window.run("key", key)
    window.wait_for(f"open({str(log)!r}).read().count({call!r}) > {before}", 60)
    window.settle()
