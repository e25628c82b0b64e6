"""Run the operators of the extension inside Blender for the demo. Started by scripts/demo.py.

Arguments: extension zip, photo folder, folder for the results, prompts as in ``--prompts``, preset.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

MODULE = "bl_ext.user_default.gaussian_heritage"

_PICTURE_SIDE = 640
"""Longest side of the rendered picture in pixels. Rays cross many Gaussians, so Cycles takes 0.2 ms of CPU a pixel."""


def main() -> int:
    """Import photos, export objects as PLY and GLB, render a picture, save a .blend file; return the exit code."""
    zip_file, photos, out, prompts, preset = sys.argv[1:6]
    logging.basicConfig(level=logging.INFO, format="  %(message)s", stream=sys.stdout)
    folder = Path(out)
    project = folder / "project"
    started = time.monotonic()
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
    bpy.context.preferences.addons[MODULE].preferences.engine_python = os.environ["GAUSSIAN_HERITAGE_PYTHON"]
    print(f"Working in {project}; follow it with: tail -f {project / 'log.jsonl'}", flush=True)
    try:
        bpy.ops.heritage.import_photo_folder(directory=photos, project=str(project), prompts=prompts, preset=preset)
        files = _export(folder / "exported")
    except RuntimeError as error:
        print(f"The demo stopped. {str(error).strip()} Run the same command again to continue.", file=sys.stderr)
        return 1
    scene_file, picture = folder / "scene.blend", folder / "scene.png"
    _render(picture)
    bpy.ops.wm.save_as_mainfile(filepath=str(scene_file))

    print(f"\nDone in {(time.monotonic() - started) / 60:.1f} minutes.")
    print(f"  Blender scene   {scene_file}")
    print(f"  its picture     {picture}")
    for file in files:
        print(f"  exported        {file}")
    print(f"  report          {project / 'report' / 'report.html'}")
    stages = json.loads((project / "project.json").read_text(encoding="utf-8"))["stages"]
    for prompt, reason in stages.get("objects", {}).get("figures", {}).get("refused", {}).items():
        print(f"  not isolated    {prompt}: {reason}")
    return 0


def _export(folder: Path) -> list[Path]:
    """Export the whole scene and every object as PLY and GLB, and return the files."""
    folder.mkdir(exist_ok=True)
    has_objects = any(obj.heritage.role == "OBJECT" for obj in bpy.context.scene.objects)
    for scope in ("SCENE", "ALL") if has_objects else ("SCENE",):
        for file_format in ("PLY", "GLB"):
            bpy.ops.heritage.export_objects(
                directory=str(folder),
                format=file_format,
                scope=scope,
                with_hidden=True,
                with_background=True,
                overwrite=True,
            )
    return sorted(folder.iterdir())


def _render(picture: Path) -> None:
    scene = bpy.context.scene
    bpy.ops.heritage.look_through_photo(longest_side=_PICTURE_SIDE)
    scene.render.filepath = str(picture)
    print("Rendering a picture with Cycles ...", flush=True)
    with _quiet():
        bpy.ops.render.render(write_still=True)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Discard the output of Cycles, which it writes to file descriptor 1 without Python."""
    sys.stdout.flush()
    stdout = os.dup(1)
    with open(os.devnull, "wb") as null:
        os.dup2(null.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)


if __name__ == "__main__":
    sys.exit(main())
