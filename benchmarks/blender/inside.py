"""What is measured in Blender as a Python module (bpy): import, and pictures by Cycles. `__main__` starts it.

example: .venv/blender-5.2/bin/python -m benchmarks.blender.inside import scene.ply
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NoReturn

import bpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

from check_contracts import link_repository  # noqa: E402

_MEMORY_UNIT = 1024
"""Bytes, in which Linux reports the largest memory."""


def main() -> NoReturn:
    """Measure one thing, print it as JSON and end the process."""
    code = 1
    try:
        with tempfile.TemporaryDirectory() as name:
            link_repository(Path(name))
            sys.path.insert(0, name)
            import gaussian_heritage  # type: ignore[import-not-found]

            gaussian_heritage.register()
            bpy.ops.wm.read_homefile(use_empty=True)
            measure = {"import": import_cost, "cycles": cycles_picture, "objects": object_pictures}[sys.argv[1]]
            result = measure(*sys.argv[2:])
        print(json.dumps({"blender": ".".join(map(str, bpy.app.version)), **result}), flush=True)
        code = 0
    except Exception as error:
        print(repr(error), file=sys.stderr, flush=True)
    # Blender's clean-up waits forever if references to its data are left, as after an error.
    os._exit(code)


def import_cost(file: str) -> dict[str, Any]:
    """Return the seconds and the memory that the import of a PLY takes."""
    from gaussian_heritage.gaussian_heritage_addon.project.scene_file import add_splat_file

    before = _peak()
    cpu, wall = time.process_time(), time.perf_counter()
    add_splat_file(bpy.context.scene, Path(file), "scene")
    bpy.context.view_layer.update()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return {"cpu": cpu, "wall": wall, "before": before, "peak": _peak()}


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _MEMORY_UNIT


def cycles_picture(project: str, photo: str, side: str, out: str) -> dict[str, Any]:
    """Render the view of a photo as the import sets it up, `side` pixels long, and return the seconds."""
    from gaussian_heritage.gaussian_heritage_addon.project.scene_file import open_project

    scene = bpy.context.scene
    open_project(scene, Path(project))
    bpy.ops.heritage.look_through_photo(photo=photo, longest_side=int(side))
    scene.render.filepath = out
    cpu, wall = time.process_time(), time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return {"cpu": time.process_time() - cpu, "wall": time.perf_counter() - wall}


def object_pictures(project: str, side: str, folder: str, *asked: str) -> dict[str, Any]:
    """Render objects of a project by Cycles, each in its own file, appended to a new file, and linked to one.

    Parameters
    ----------
    project : str
    side : str
        Longest side of the pictures in pixels.
    folder : str
        For the pictures, ``<id>_<place>.png``, and the files.
    *asked : str
        ``<id>=<photo>``, the photo whose view is rendered.
    """
    from gaussian_heritage.gaussian_heritage_addon.project.scene_file import open_project
    from gaussian_heritage.gaussian_heritage_addon.splats.properties import photo_of

    out, photos = Path(folder), dict(word.split("=", 1) for word in asked)
    open_project(bpy.context.scene, Path(project))
    bpy.context.scene.heritage.show = "OBJECTS"
    file = out / "objects.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    cpu = time.process_time()
    names = {obj.heritage.object_id: obj.name for obj in bpy.context.scene.objects if obj.heritage.role == "OBJECT"}
    for object_id, photo in photos.items():
        bpy.ops.wm.open_mainfile(filepath=str(file))
        for obj in bpy.context.scene.objects:
            if obj.heritage.role == "OBJECT":
                obj.heritage.hidden = obj.heritage.object_id != object_id
        camera = next(obj.name for obj in bpy.context.scene.objects if photo_of(obj) == photo)
        _render(photo, side, out / f"{object_id}_shown.png")
        for place, brings in (("appended", bpy.ops.wm.append), ("linked", bpy.ops.wm.link)):
            bpy.ops.wm.read_homefile(use_empty=True)
            bpy.ops.wm.append(directory=f"{file}/Object/", filename=camera)
            brings(directory=f"{file}/Object/", filename=names[object_id])
            _render(photo, side, out / f"{object_id}_{place}.png")
    return {"cpu": time.process_time() - cpu}


def _render(photo: str, side: str, out: Path) -> None:
    """Render what F12 renders in the view of a photo, once the scene is set up, on black."""
    scene = bpy.context.scene
    bpy.ops.heritage.set_up_render()
    bpy.ops.heritage.look_through_photo(photo=photo, longest_side=int(side))
    scene.render.filepath = str(out)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
