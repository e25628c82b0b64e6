"""Functions that run in a Blender window: its text is sent there, see `window`. Nothing here is imported."""

from __future__ import annotations

import importlib
import json
import time
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Quaternion

PACKAGE = "bl_ext.user_default.gaussian_heritage"
_TURN = 0.02
"""Radians by which the view turns between two redraws."""
_REPEATS = 6


def part(name: str) -> Any:
    """Return a module of the add-on."""
    return importlib.import_module(f"{PACKAGE}.{name}")


def viewport() -> tuple[Any, Any, Any]:
    """Return the window, its 3D viewport and the region of it."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def redraw() -> tuple[float, float]:
    """Redraw the viewport, and return the CPU and wall seconds."""
    window, area, region = viewport()
    region.tag_redraw()
    cpu, wall = time.process_time(), time.perf_counter()
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    return time.process_time() - cpu, time.perf_counter() - wall


def show(kind: str, *, shading: str = "SOLID", share: float = 0.0, lighter: bool = True) -> None:
    """Set how splats are shown; without a share, it stays as it is."""
    _, area, _ = viewport()
    area.spaces.active.shading.type = shading
    settings = bpy.context.scene.heritage_display
    settings.kind, settings.share, settings.lighter = kind, share or settings.share, lighter


def turn(**display: Any) -> None:
    """Print the median CPU and wall seconds of a redraw while the view turns."""
    _, area, _ = viewport()
    show(**display)
    view = area.spaces.active.region_3d
    view.view_perspective = "PERSP"
    redraw()
    costs = []
    for _ in range(_REPEATS):
        view.view_rotation = Quaternion((0, 0, 1), _TURN) @ view.view_rotation
        costs.append(redraw())
    print(json.dumps(np.median(costs, axis=0).tolist()))


def nothing_shown() -> None:
    """Print the cost of a redraw of the same window without splats, as `turn`."""
    hidden = [obj for obj in bpy.context.scene.objects if obj.heritage.role != "NONE" and not obj.hide_viewport]
    for obj in hidden:
        obj.hide_viewport = True
    turn(kind="SPLATS")
    for obj in hidden:
        obj.hide_viewport = False


def click() -> None:
    """Print the CPU and wall seconds of the first click on visible splats, and of asking Blender for lines there."""
    window, area, region = viewport()
    selection, sight_type = (
        part("gaussian_heritage_addon.splats.view_selection"),
        part("gaussian_heritage_addon.splats.sight"),
    )
    place = region.width // 2, region.height // 2
    costs = []
    with bpy.context.temp_override(window=window, area=area, region=region):
        matrix = np.array(region.data.perspective_matrix, np.float64)
        sight = sight_type.Sight(region.width, region.height, matrix)
        for step in ("click", "ask"):
            cpu, wall = time.process_time(), time.perf_counter()
            if step == "click":
                splats = selection.selectable_splats(bpy.context)
                _, distance = selection.object_seen(splats, sight.ray(place[0] + 0.5, place[1] + 0.5))
                selection.hides_splats(bpy.context, sight, place, distance)
            else:
                selection._has_line(bpy.context, place, [])
            costs.append((time.process_time() - cpu, time.perf_counter() - wall))
    print(json.dumps(costs))


def slide(count: int) -> None:
    """Print the median CPU and wall seconds from a change of the threshold of a new object to the redrawn window."""
    rng, scene = np.random.default_rng(0), bpy.context.scene

    def normal(*shape: int) -> Any:
        return rng.standard_normal(shape).astype(np.float32)

    gaussians = part("engine.scene").Gaussians(
        means=normal(count, 3),
        log_scales=normal(count, 3) - 5,
        quats=normal(count, 4),
        opacity_logits=normal(count) + 2,
        sh=0.3 * normal(count, 4, 3),
    )
    membership = rng.random(count).astype(np.float32)
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.create(
        "slid", gaussians, scene.collection, membership=membership
    )
    obj = splats.object
    obj.heritage.role = "OBJECT"
    for other in scene.objects:
        other.hide_viewport = other != obj
    redraw()
    rest, costs, evaluations = [], [], []
    for number in range(_REPEATS):
        rest.append(redraw())
        cpu, wall = time.process_time(), time.perf_counter()
        obj.heritage.threshold = 0.3 + 0.05 * (number % 8)
        bpy.context.view_layer.update()
        evaluations.append((time.process_time() - cpu, time.perf_counter() - wall))
        costs.append(np.add(evaluations[-1], redraw()))
    medians = [np.median(values, axis=0).tolist() for values in (evaluations, costs, rest)]
    bpy.data.objects.remove(obj)
    print(json.dumps(medians))


def import_large(file: str) -> None:
    """Import a large PLY, and print the CPU and wall seconds of the first redraw, and the share that is shown."""
    for obj in list(bpy.context.scene.objects):
        if obj.heritage.role != "NONE":
            bpy.data.objects.remove(obj)
    part("gaussian_heritage_addon.project.scene_file").add_splat_file(bpy.context.scene, Path(file), "large")
    bpy.context.scene.heritage.show = "SCENE"
    show("SPLATS")
    cost = redraw()
    print(json.dumps([*cost, bpy.context.scene.heritage_display.share]))


def picture(photo: str, side: int, share: float, out: str) -> None:
    """Save what the shader of the viewports draws of the scene in the view of a photo."""
    bpy.ops.heritage.look_through_photo(photo=photo, longest_side=side)
    drawn([obj for obj in bpy.context.scene.objects if obj.heritage.role == "SCENE"], share, out)


def drawn(objects: list[Any], share: float, out: str) -> None:
    """Save what the shader of the viewports draws of objects in the view of the scene's camera."""
    scene, view = bpy.context.scene, part("gaussian_heritage_addon.splats.splat_view")
    width, height = scene.render.resolution_x, scene.render.resolution_y
    camera = scene.camera
    window_matrix = camera.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(),
        x=width,
        y=height,
        scale_x=scene.render.pixel_aspect_x,
        scale_y=scene.render.pixel_aspect_y,
    )
    offscreen = gpu.types.GPUOffScreen(width, height, format="RGBA16F")
    detail = view.Detail(share=share)
    view.draw_to(offscreen, view.tables_of(objects), objects, camera.matrix_world.inverted(), window_matrix, detail)
    buffer = offscreen.texture_color.read()
    buffer.dimensions = width * height * 4
    np.save(out, np.array(buffer, np.float32).reshape(height, width, 4)[::-1, :, :3])
