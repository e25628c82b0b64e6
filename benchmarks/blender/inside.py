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
            measure = {"import": import_cost, "cycles": cycles_picture}[sys.argv[1]]
            result = measure(*sys.argv[2:])
        print(json.dumps({"blender": ".".join(map(str, bpy.app.version)), **result}), flush=True)
        code = 0
    except Exception as error:
        print(repr(error), file=sys.stderr, flush=True)
    # Blender's clean-up waits forever if references to its data are left, as after an error.
    os._exit(code)


def import_cost(file: str) -> dict[str, Any]:
    """Return the seconds and the memory that the import of a PLY takes."""
    from gaussian_heritage.gaussian_heritage_addon.scene_file import add_splat_file

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
    from gaussian_heritage.gaussian_heritage_addon.scene_file import open_project

    scene = bpy.context.scene
    open_project(scene, Path(project))
    bpy.ops.heritage.look_through_photo(photo=photo, longest_side=int(side))
    scene.render.filepath = out
    cpu, wall = time.process_time(), time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return {"cpu": time.process_time() - cpu, "wall": time.perf_counter() - wall}


if __name__ == "__main__":
    main()
