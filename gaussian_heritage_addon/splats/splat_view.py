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

from ..blender.guards import (
    Timer,
    add_change_handler,
    add_draw_handler,
    add_load_handler,
    add_update_handler,
    on_unregister,
    remove_draw_handler,
)
from ..blender.world_placement import drawn_matrix
from .display_settings import apply_displays
from .edited_splats import EditedSplats, edited_splats, is_editing_splats, vertex_flags
from .properties import photo_of
from .selection import active_object, heritage_objects
from .solid_mode import redraw_viewports
from .splat_boxes import Box, draw_boxes, shown_box
from .splat_order import View, draw_order
from .splat_shader import copy_shader, splat_shader
from .splat_tables import Part, Tables, checksum, list_texture
from .splats import SplatScene

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
_TINT = 0.65
"""Share of the theme's colour of selected vertices in the colour of a selected Gaussian."""
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


_Flags = tuple[NDArray[np.bool_], NDArray[np.bool_]]
"""Which Gaussians of an object in Edit Mode are selected, and which are hidden."""


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
    """Values that are kept between two draws."""

    parts: dict[str, Part] = field(default_factory=dict)
    versions: dict[str, int] = field(default_factory=dict)
    edited: dict[str, int] = field(default_factory=dict)
    doubtful: set[str] = field(default_factory=set)
    tables: Tables | None = None
    tables_of: Any = None
    boxes: dict[str, tuple[Any, Box | None]] = field(default_factory=dict)
    pictures: dict[int, _Picture] = field(default_factory=dict)
    programs: tuple[Any, Any, Any, Any] | None = None
    n_updates: int = 0
    flags: dict[str, tuple[int, _Flags]] = field(default_factory=dict)


_state = _State()
_handle: Any = None


def is_software() -> bool:
    """Return whether the viewports are drawn without a graphics card."""
    return not bpy.app.background and gpu.platform.device_type_get() == "SOFTWARE"


def _forget(changed: list[bpy.types.ID]) -> None:
    """Look again at the data that may have changed, when they are drawn next."""
    _state.doubtful.update(data.name_full for data in changed if isinstance(data, bpy.types.Mesh))


def _count_update() -> None:
    _state.n_updates += 1


def _forget_all() -> None:
    """Forget everything but the programs."""
    _state.flags.clear()
    _state.parts.clear()
    _state.doubtful.clear()
    _state.boxes.clear()
    _state.pictures.clear()
    _state.tables = _state.tables_of = None


def _begin_file() -> None:
    """Forget the data of the last file, and draw those of this one as they are drawn now."""
    _forget_all()
    apply_displays()
    _start()


def shown_splats(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the splats that the viewport of `context` shows, also in Edit Mode."""
    return [
        obj
        for obj in heritage_objects(context.scene)
        if SplatScene.is_splats(obj)
        and len(obj.data.vertices)
        and obj.visible_get(view_layer=context.view_layer, viewport=context.space_data)
    ]


def _source(obj: bpy.types.Object) -> SplatScene | EditedSplats | None:
    """Return what the Gaussians of an object are read from; None where they cannot be read yet."""
    return edited_splats(obj) if is_editing_splats(obj) else SplatScene.of(obj)


def tables_of(objects: list[bpy.types.Object]) -> Tables:
    """Return the Gaussians of `objects` as lists on the card, which are kept until one of them changes.

    Objects in Edit Mode must be read already, see `edited_splats`.
    """
    names = [obj.data.name_full for obj in objects]
    sources = [source for source in map(_source, objects) if source is not None]
    for name, source in zip(names, sources, strict=True):
        part = _state.parts.get(name)
        if part is None or _has_changed(name, part, source):
            _state.parts[name] = Part.of(source)
            _state.versions[name] = _state.versions.get(name, 0) + 1
        if isinstance(source, SplatScene):
            _state.doubtful.discard(name)
            _state.edited.pop(name, None)
        else:
            _state.edited[name] = source.version
    wanted = tuple((name, _state.versions[name]) for name in names)
    if _state.tables is None or _state.tables_of != wanted:
        _state.tables, _state.tables_of = Tables(sources, [_state.parts[name] for name in names]), wanted
    return _state.tables


def _has_changed(name: str, part: Part, source: SplatScene | EditedSplats) -> bool:
    if isinstance(source, EditedSplats):
        return _state.edited.get(name) != source.version and checksum(source) != part.checksum
    if len(part.means) != len(source.object.data.vertices):
        return True
    return (name in _state.doubtful or name in _state.edited) and checksum(source) != part.checksum


def _flags_of(obj: bpy.types.Object, count: int) -> _Flags:
    """Return which of the `count` Gaussians of an object in Edit Mode are selected and hidden, read after a change."""
    known = _state.flags.get(obj.name)
    if known is None or known[0] != _state.n_updates or len(known[1][0]) != count:
        # The picture may be older than the vertices, where some were added or deleted.
        both = [np.zeros(count, bool), np.zeros(count, bool)]
        for flags, read in zip(both, vertex_flags(obj), strict=True):
            flags[: len(read)] = read[:count]
        known = _state.flags[obj.name] = _state.n_updates, (both[0], both[1])
    return known[1]


def _draw() -> None:
    """Draw the splats over the region that Blender draws."""
    context = bpy.context
    settings, region, view = context.scene.heritage_display, context.region, context.region_data
    if settings.kind == "SHAPES" or view is None:
        return
    objects = [obj for obj in shown_splats(context) if _source(obj) is not None]
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
    flags = {
        obj.name: _flags_of(obj, len(part.means))
        for obj, part in zip(objects, tables.parts, strict=True)
        if is_editing_splats(obj)
    }
    shown = seen, _state.tables_of, detail, _state.n_updates if flags else 0
    # Other objects may have moved.
    if picture.shown != shown or scene_depth is not None or picture.has_depth:
        draw_to(picture.offscreen, tables, objects, view.view_matrix, view.window_matrix, detail, scene_depth, flags)
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
        draw_boxes(context, {obj.name: _box(obj) for obj in _boxed(context, objects)})
        gpu.state.blend_set("NONE")


def _boxed(context: bpy.types.Context, objects: list[bpy.types.Object]) -> list[bpy.types.Object]:
    """Return the objects that may have a box: those that are shown, and the one of the list that the scene replaces."""
    chosen = active_object(context.scene)
    boxed = [obj for obj in objects if not is_editing_splats(obj)]
    if chosen is not None and chosen not in objects and not chosen.heritage.hidden and SplatScene.is_splats(chosen):
        boxed.append(chosen)
    return boxed


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
    # One that was never drawn has no version.
    shown = _state.versions.get(name), len(obj.data.vertices), obj.heritage.threshold
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
    flags: dict[str, _Flags] | None = None,
) -> None:
    """Draw `objects`, whose Gaussians are in `tables`, seen by a view, into a picture.

    Parameters
    ----------
    view_matrix, window_matrix : Matrix
        Those of a viewport, or of a camera.
    scene_depth : GPUTexture, optional
        Depth, 0 to 1, beyond which nothing is drawn.
    flags : dict, optional
        By name of an object in Edit Mode: which of its Gaussians are selected, and are tinted, and which are hidden.
    """
    window = window_matrix
    is_perspective = window[3][3] == 0.0
    column = 2 if is_perspective else 3
    view = View((window[0][0], window[1][1]), (window[0][column], window[1][column]), is_perspective)
    placements = [view_matrix @ drawn_matrix(obj) for obj in objects]
    order = _order(tables, objects, placements, view, detail.share, flags or {})
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
            list_texture(order),
            tables.shapes,
            tables.colors,
            list_texture(rows.reshape(-1, 4)),
        )
        for name, texture in zip(("order", "shapes", "colors", "objects"), lists, strict=True):
            program.uniform_sampler(name, texture)
        # A sampler must be set, even where it is not read.
        program.uniform_sampler("scene_depth", lists[0] if scene_depth is None else scene_depth)
        program.uniform_bool("is_hidden", [scene_depth is not None])
        program.uniform_float("tint", _tint())
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


def _tint() -> tuple[float, float, float, float]:
    red, green, blue = bpy.context.preferences.themes[0].view_3d.vertex_select[:3]
    return red, green, blue, _TINT


def _order(
    tables: Tables,
    objects: list[bpy.types.Object],
    placements: list[Matrix],
    view: View,
    share: float,
    flags: dict[str, _Flags],
) -> NDArray[np.float32]:
    """Return the list of what is drawn, the farthest first, for the shader."""
    centers = np.empty((tables.starts[-1], 3), np.float32)
    radii = np.empty(len(centers), np.float32)
    weights = np.empty(len(centers), np.float32)
    members, selected = np.ones(len(centers), bool), np.zeros(len(centers), bool)
    for start, part, obj, placement in zip(tables.starts, tables.parts, objects, placements, strict=False):
        rows = slice(start, start + len(part.means))
        matrix = np.array(placement, np.float32)
        centers[rows] = part.means @ matrix[:3, :3].T + matrix[:3, 3]
        enlarged = float(np.abs(placement.to_3x3().determinant())) ** (1 / 3)
        radii[rows], weights[rows] = part.radii * enlarged, part.weights * enlarged
        if part.membership is not None:
            members[rows] = part.membership >= np.float32(obj.heritage.threshold)
        if obj.name in flags:
            selected[rows], hidden = flags[obj.name]
            members[rows] &= ~hidden
    order = draw_order(centers, radii, weights, view, share=share, members=members)
    return np.where(selected[order], -1.0 - order, order).astype(np.float32)


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
    on_unregister(_end)
    if not bpy.app.background:
        _start()
        add_change_handler(_forget)
        add_update_handler(_count_update)
        add_load_handler(_begin_file)


def _end() -> None:
    _stop()
    _forget_all()
    _state.programs = None
