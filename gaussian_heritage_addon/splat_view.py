"""Draws the splats in the 3D viewports, in every mode of shading, by a shader of our own.

Blender's modes are made for other objects: software OpenGL needs minutes for a scene of splats in Material Preview, and
the mode Solid has no transparency. Here, the Gaussians are sorted by depth, projected as in the engine's rasterizer and
blended in sRGB values, as in training. What other objects hide is left out.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix
from numpy.typing import NDArray

from .display_settings import renew_displays
from .guards import (
    Timer,
    add_change_handler,
    add_draw_handler,
    add_load_handler,
    remove_change_handler,
    remove_draw_handler,
    remove_handler,
)
from .properties import heritage_objects, photo_of
from .solid_mode import redraw_viewports
from .splat_boxes import Box, draw_boxes, shown_box
from .splat_order import View, draw_order
from .splat_shader import copy_shader, splat_shader
from .splat_tables import Part, Tables, checksum, list_texture
from .splats import SplatScene
from .world_placement import drawn_matrix

__all__ = ["Detail", "draw_to", "is_software", "register", "tables_of", "unregister"]

_REST = 0.25
"""Seconds without a change after which the view is taken to rest."""
_COARSE = 0.5
"""Side of the picture while the view moves, as a share of its full side, without a graphics card."""
_MOST_MOVING, _SH_MOVING = 100_000, 4
"""Gaussians that are drawn then, and spherical harmonics that are evaluated for each."""
_DOT_SIZE = 1.6
"""Half the size of a point in pixels."""
_OPAQUE = frozenset(("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"))
"""Types of objects that may hide splats."""
_CORNERS = ((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0))


@dataclass(frozen=True)
class Detail:
    """How much of the Gaussians is drawn.

    Attributes
    ----------
    share : float
        See `draw_order`.
    n_sh : int
        Spherical harmonics that are evaluated, 1, 4, 9 or 16.
    is_points : bool
        Draw dots of one size.
    """

    share: float = 1.0
    n_sh: int = 16
    is_points: bool = False


@dataclass
class _Picture:
    """The last picture of a region.

    Attributes
    ----------
    offscreen : GPUOffScreen or None
    seen : tuple or None
        View, placements and thresholds at the last draw.
    moved : float
        When they changed.
    shown : tuple or None
        What the picture shows.
    has_depth : bool
        Whether other objects may hide splats in it.
    """

    offscreen: Any = None
    seen: Any = None
    moved: float = 0.0
    shown: Any = None
    has_depth: bool = False


@dataclass
class _State:
    """What is kept between two draws."""

    parts: dict[str, Part] = field(default_factory=dict)
    versions: dict[str, int] = field(default_factory=dict)
    doubtful: set[str] = field(default_factory=set)
    tables: Tables | None = None
    tables_of: Any = None
    boxes: dict[str, tuple[Any, Box | None]] = field(default_factory=dict)
    pictures: dict[int, _Picture] = field(default_factory=dict)
    programs: tuple[Any, Any, Any, Any] | None = None


_state = _State()
_handle: Any = None


def is_software() -> bool:
    """Return whether the viewports are drawn without a graphics card."""
    return not bpy.app.background and gpu.platform.device_type_get() == "SOFTWARE"


def _forget(changed: list[bpy.types.ID]) -> None:
    """Look again at the data that may have changed, when they are drawn next."""
    _state.doubtful.update(data.name_full for data in changed if isinstance(data, bpy.types.Mesh))


def _forget_all() -> None:
    """Forget everything but the programs."""
    _state.parts.clear()
    _state.doubtful.clear()
    _state.boxes.clear()
    _state.pictures.clear()
    _state.tables = _state.tables_of = None


def _begin_file() -> None:
    """Forget the data of the last file, and draw those of this one as they are drawn now."""
    _forget_all()
    renew_displays()
    _start()


def _shown(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the splats that the viewport shows; in Edit Mode Blender draws them."""
    return [
        obj
        for obj in heritage_objects(context.scene)
        if obj.mode != "EDIT"
        and SplatScene.is_splats(obj)
        and len(obj.data.vertices)
        and obj.visible_get(view_layer=context.view_layer, viewport=context.space_data)
    ]


def tables_of(objects: list[bpy.types.Object]) -> Tables:
    """Return the Gaussians of `objects` as lists on the card, which are kept until one of them changes."""
    names = [obj.data.name_full for obj in objects]
    for obj, name in zip(objects, names, strict=True):
        part, splats = _state.parts.get(name), SplatScene.of(obj)
        if (
            part is None
            or len(part.means) != len(obj.data.vertices)
            or (name in _state.doubtful and checksum(splats) != part.checksum)
        ):
            _state.parts[name] = Part.of(splats)
            _state.versions[name] = _state.versions.get(name, 0) + 1
        _state.doubtful.discard(name)
    wanted = tuple((name, _state.versions[name]) for name in names)
    if _state.tables is None or _state.tables_of != wanted:
        every = [SplatScene.of(obj) for obj in objects]
        _state.tables, _state.tables_of = Tables(every, [_state.parts[name] for name in names]), wanted
    return _state.tables


def _draw() -> None:
    """Draw the splats over the region that Blender draws."""
    context = bpy.context
    settings, region, view = context.scene.heritage_display, context.region, context.region_data
    if settings.kind == "SHAPES" or view is None:
        return
    objects = _shown(context)
    if not objects:
        return
    # A new picture takes its place.
    target = gpu.state.active_framebuffer_get()
    scene_depth = _scene_depth(context, objects, target)
    tables = tables_of(objects)
    picture = _state.pictures.get(region.as_pointer()) or _Picture()
    # The user turns the view, moves an object or drags its threshold.
    placed = tuple(map(tuple, (*view.view_matrix, *view.window_matrix))), region.width, region.height
    seen = placed, tuple((obj.heritage.threshold, tuple(map(tuple, drawn_matrix(obj)))) for obj in objects)
    now = time.monotonic()
    if picture.seen not in (None, seen):
        picture.moved = now
    picture.seen = seen
    coarse = settings.lighter and is_software() and now - picture.moved < _REST
    detail = _detail(settings, tables, coarse=coarse)
    side = _COARSE if coarse else 1.0
    size = max(1, round(region.width * side)), max(1, round(region.height * side))
    if picture.offscreen is None or (picture.offscreen.width, picture.offscreen.height) != size:
        _forget_closed_regions()
        picture.offscreen, picture.shown = gpu.types.GPUOffScreen(*size, format="RGBA16F"), None
        _state.pictures[region.as_pointer()] = picture
    shown = seen, _state.tables_of, detail
    # Other objects may have moved.
    if picture.shown != shown or scene_depth is not None or picture.has_depth:
        draw_to(picture.offscreen, tables, objects, view.view_matrix, view.window_matrix, detail, scene_depth)
        picture.shown, picture.has_depth = shown, scene_depth is not None
    if coarse:
        _rest_timer.start(_REST)
    _, _, copy, copy_batch = _programs()
    with target.bind():
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_test_set("NONE")
        copy.bind()
        copy.uniform_sampler("finished", picture.offscreen.texture_color)
        copy.uniform_float("strength", _strength(context, view))
        copy_batch.draw(copy)
        draw_boxes(context, {obj.name: _box(obj) for obj in objects})
        gpu.state.blend_set("NONE")


def _detail(settings: Any, tables: Tables, *, coarse: bool) -> Detail:
    share, n_sh, is_points = settings.share, tables.n_coefficients, settings.kind == "POINTS"
    if coarse:
        share, n_sh = min(share, _MOST_MOVING / tables.starts[-1]), min(n_sh, _SH_MOVING)
    return Detail(share, 1 if is_points else n_sh, is_points=is_points)


def _strength(context: bpy.types.Context, view: bpy.types.RegionView3D) -> float:
    """Return how much the splats cover what Blender has drawn: the photo that the user looks through shines through."""
    camera = context.scene.camera
    if view.view_perspective != "CAMERA" or camera is None or not photo_of(camera):
        return 1.0
    photos = (one for one in camera.data.background_images if one.image is not None and one.image.has_data)
    is_shown = camera.data.show_background_images and any(photos)
    return 1.0 - context.scene.heritage.photo_opacity if is_shown else 1.0


def _forget_closed_regions() -> None:
    windows = bpy.context.window_manager.windows
    regions = {region.as_pointer() for window in windows for area in window.screen.areas for region in area.regions}
    for key in _state.pictures.keys() - regions:
        del _state.pictures[key]


def _scene_depth(
    context: bpy.types.Context, splats: list[bpy.types.Object], target: gpu.types.GPUFrameBuffer
) -> gpu.types.GPUTexture | None:
    """Return the depth of what Blender has drawn of other objects; None where there are none."""
    others = (obj for obj in context.visible_objects if obj.type in _OPAQUE and obj not in splats)
    if not any(obj.display_type in ("TEXTURED", "SOLID") for obj in others):
        return None
    size = context.region.width, context.region.height
    depth = target.read_depth(0, 0, *size)
    depth.dimensions = size[0] * size[1]
    return gpu.types.GPUTexture(size, format="R32F", data=depth)


def _box(obj: bpy.types.Object) -> Box | None:
    """Return the box around what is shown of an object, computed again only when that has changed."""
    name = obj.data.name_full
    shown = _state.versions[name], obj.heritage.threshold
    if name not in _state.boxes or _state.boxes[name][0] != shown:
        _state.boxes[name] = shown, shown_box(obj)
    return _state.boxes[name][1]


def draw_to(
    offscreen: gpu.types.GPUOffScreen,
    tables: Tables,
    objects: list[bpy.types.Object],
    view_matrix: Matrix,
    window_matrix: Matrix,
    detail: Detail,
    scene_depth: gpu.types.GPUTexture | None = None,
) -> None:
    """Draw `objects`, whose Gaussians are in `tables`, seen by a view, into a picture.

    Parameters
    ----------
    offscreen : GPUOffScreen
    tables : Tables
    objects : list of Object
    view_matrix, window_matrix : Matrix
        Those of a viewport, or of a camera.
    detail : Detail
    scene_depth : GPUTexture, optional
        Depth, 0 to 1, beyond which nothing is drawn.
    """
    window = window_matrix
    is_perspective = window[3][3] == 0.0
    column = 2 if is_perspective else 3
    view = View((window[0][0], window[1][1]), (window[0][column], window[1][column]), is_perspective)
    placements = [view_matrix @ drawn_matrix(obj) for obj in objects]
    order = _order(tables, objects, placements, view, detail.share)
    rows = np.zeros((len(objects), 4, 4), np.float32)
    for number, placement in enumerate(placements):
        rows[number, :3] = np.array(placement)[:3]
        rows[number, 3, :3] = _eye(placement, is_perspective)
        rows[number, 3, 3] = SplatScene.of(objects[number]).is_antialiased
    program, batch, _, _ = _programs()
    with offscreen.bind():
        gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0))
        if not len(order):
            return
        gpu.state.blend_set("ALPHA_PREMULT")
        gpu.state.depth_test_set("NONE")
        program.bind()
        lists = (
            list_texture(order.astype(np.float32)),
            tables.shapes,
            tables.colors,
            list_texture(rows.reshape(-1, 4)),
        )
        for name, texture in zip(("order", "shapes", "colors", "objects"), lists, strict=True):
            program.uniform_sampler(name, texture)
        # A sampler must be set, even where it is not read.
        program.uniform_sampler("scene_depth", lists[0] if scene_depth is None else scene_depth)
        program.uniform_bool("is_hidden", [scene_depth is not None])
        program.uniform_float("depth_row", (window[2][2], window[2][3]))
        program.uniform_float("scale_shift", (*view.scale, *view.shift))
        program.uniform_float("size", (offscreen.width, offscreen.height))
        program.uniform_float("dot_size", _DOT_SIZE if detail.is_points else 0.0)
        program.uniform_int("n_coefficients", tables.n_coefficients)
        program.uniform_int("n_evaluated", min(detail.n_sh, tables.n_coefficients))
        program.uniform_bool("perspective", [is_perspective])
        batch.draw_instanced(program, instance_count=len(order))
        gpu.state.blend_set("NONE")


def _eye(placement: Matrix, is_perspective: bool) -> tuple[float, float, float]:
    """Return the camera in the frame of an object; without perspective, a point far behind it."""
    inverse = placement.inverted_safe()
    eye = inverse.translation if is_perspective else inverse @ Matrix.Translation((0, 0, 1e6)).translation
    return tuple(eye)


def _order(
    tables: Tables, objects: list[bpy.types.Object], placements: list[Matrix], view: View, share: float
) -> NDArray[np.intp]:
    centers = np.empty((tables.starts[-1], 3), np.float32)
    radii = np.empty(len(centers), np.float32)
    weights = np.empty(len(centers), np.float32)
    members = np.ones(len(centers), bool)
    for start, part, obj, placement in zip(tables.starts, tables.parts, objects, placements, strict=False):
        rows = slice(start, start + len(part.means))
        matrix = np.array(placement, np.float32)
        centers[rows] = part.means @ matrix[:3, :3].T + matrix[:3, 3]
        enlarged = float(np.abs(placement.to_3x3().determinant())) ** (1 / 3)
        radii[rows], weights[rows] = part.radii * enlarged, part.weights * enlarged
        if part.membership is not None:
            members[rows] = part.membership >= np.float32(obj.heritage.threshold)
    return draw_order(centers, radii, weights, view, share=share, members=members)


def _programs() -> tuple[Any, Any, Any, Any]:
    if _state.programs is None:
        program, copy = splat_shader(), copy_shader()
        batches = [batch_for_shader(one, "TRI_STRIP", {"corner": _CORNERS}) for one in (program, copy)]
        _state.programs = (program, batches[0], copy, batches[1])
    return _state.programs


_rest_timer = Timer(redraw_viewports)


def _show_shapes() -> None:
    """Let Blender draw what the shader could not. The panel shows what went wrong."""
    for scene in bpy.data.scenes:
        scene.heritage_display.kind = "SHAPES"


# While a region is drawn, data must not change.
_shapes_timer = Timer(_show_shapes)


def _failed() -> None:
    _shapes_timer.start(0.0)


def _start() -> None:
    """Draw in all viewports, also when that has failed before."""
    global _handle
    _stop()
    _handle = add_draw_handler(bpy.types.SpaceView3D, _draw, "POST_VIEW", failed=_failed)


def _stop() -> None:
    global _handle
    if _handle is not None:
        remove_draw_handler(bpy.types.SpaceView3D, _handle)
    _handle = None


def register() -> None:
    """Draw splats in all viewports."""
    if not bpy.app.background:
        _start()
        add_change_handler(_forget)
        add_load_handler(_begin_file)


def unregister() -> None:
    """Undo `register`."""
    _stop()
    _rest_timer.stop()
    _shapes_timer.stop()
    remove_change_handler(_forget)
    remove_handler(_begin_file)
    _forget_all()
    _state.programs = None
