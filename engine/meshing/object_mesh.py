"""A textured mesh of an object: depths of photos, fused, cleaned, simplified, and coloured from the photos."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..core.arrays import Float32, Float64, Int32, Mask, Pixels, normalized
from ..core.errors import ObjectError
from ..core.events import StopCheck
from ..objects import DetailPhotos, spread_cameras
from ..pictures import Scene
from ..scene import Camera, Mesh
from .agreement import agreeing_depths
from .atlas import make_atlas, texels
from .cleaning import areas_of, kept_faces, main_parts, separated, used_vertices, vertex_normals
from .depth import depth_maps
from .fusion import Field, fuse, with_unseen_filled
from .settings import MeshSettings
from .simplifying import simplified
from .surface import extract_surface
from .texture import SurfacePoints, colors_of, spread_colors

_MIN_TRIANGLES = 100
"""Triangles of the fused surface below which it is no surface but the blots of a few Gaussians."""

_TOLERANCE = 3.0
"""Voxels behind the surface within which a point is visible: simplifying moves the surface by less."""

_USED_SHARE = 0.6
"""Share of a texture that triangles cover, for the size of its pixels on the surface before they are placed."""


@dataclass(frozen=True)
class MeshResult:
    """An object's mesh.

    Attributes
    ----------
    mesh : Mesh
        In the normalised world.
    record : dict
        Figures: ``triangles``, of them ``filled`` where no photo saw, the ``filled_share`` of the area, ``watertight``,
        ``photos``, ``toward`` (see `agreeing_depths`), ``voxel``, ``area`` and ``volume`` in world units (None where it
        is not closed), side of the
        ``texture`` in pixels, ``untextured_share`` of the seen texture of which no photo gave a colour, ``seconds``.
    """

    mesh: Mesh
    record: dict[str, Any]


def mesh_object(
    scene: Scene,
    members: Mask,
    cameras: Sequence[Camera],
    photos: DetailPhotos,
    settings: MeshSettings,
    *,
    should_stop: StopCheck,
    tell: Callable[[float], None] = lambda done: None,
) -> MeshResult:
    """Return the textured mesh of an object.

    Parameters
    ----------
    scene : Scene
        The whole scene, with the object as it is shown, such as its detail.
    members : array of shape [N], bool
        The object's Gaussians.
    cameras : sequence of Camera
        Of the photos; test photos among them are not used.
    tell : callable
        Called with the fraction that is done, 0 to 1.

    Raises
    ------
    ObjectError
        When the object has no surface: no Gaussians, too transparent, or hardly shown by a photo.
    PhotoError
        When a photo cannot be read.
    Cancelled
        When `should_stop` returns True.
    """
    started = time.perf_counter()
    if not members.any():
        raise ObjectError("This object has no Gaussians, so it has no surface. Lower its threshold.")
    usable = [camera for camera in cameras if camera.photo not in photos.held_out]
    maps = depth_maps(scene, members, spread_cameras(usable, settings.max_photos), should_stop=should_stop)
    if not maps:
        raise ObjectError(
            "No photo shows a surface of this object: it is too transparent or too small. Export its Gaussians instead."
        )
    tell(0.3)
    maps, toward = agreeing_depths(maps, photos, should_stop=should_stop)
    tell(0.4)
    field = fuse(maps, should_stop=should_stop)
    tell(0.5)
    vertices, faces, seen = _geometry(field, settings)
    normals = vertex_normals(vertices, faces)
    tell(0.6)
    side = settings.texture_side
    corners, texture_faces, uv = make_atlas(vertices, faces, side) if side else _no_atlas(vertices, faces)
    tell(0.7)
    numbers, weights = texels(uv, texture_faces, side)
    area = areas_of(vertices, faces)
    texel = float(np.sqrt(area.sum() / max(_USED_SHARE * side**2, len(vertices))))
    rows, columns = np.nonzero(numbers >= 0)
    points = _points(vertices, faces, normals, seen, numbers[rows, columns], weights[rows, columns])
    colors, known = colors_of(
        points, vertices, faces, maps, photos,
        texel=texel, tolerance=_TOLERANCE * field.voxel, should_stop=should_stop,
        tell=lambda done: tell(0.7 + 0.27 * done),
    )  # fmt: skip
    n_texels = len(rows)
    vertex_colors = spread_colors(vertices, faces, colors[n_texels:], known[n_texels:])
    texture = _texture(
        side, numbers, weights, faces, vertex_colors, (rows, columns), colors[:n_texels], known[:n_texels]
    )
    mesh = Mesh(
        vertices.astype(np.float32), faces, seen, np.rint(255 * vertex_colors).astype(np.uint8), normals, corners,
        np.column_stack([uv[:, 0], 1 - uv[:, 1]]).astype(np.float32), texture_faces, texture,
    )  # fmt: skip
    closed = mesh.is_closed
    seen_texels = seen[numbers[rows, columns]]
    record = {
        "triangles": len(faces), "filled": mesh.n_filled,
        "filled_share": round(float(area[~seen].sum() / area.sum()), 4),
        "watertight": closed, "photos": len(maps), "toward": toward, "voxel": field.voxel, "area": float(area.sum()),
        "volume": mesh.volume if closed else None, "texture": side,
        "untextured_share": round(float(1 - known[:n_texels][seen_texels].mean()) if seen_texels.any() else 0.0, 4),
        "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip
    tell(1.0)
    return MeshResult(mesh, record)


def _geometry(field: Field, settings: MeshSettings) -> tuple[Float64, Int32, Mask]:
    """Return the cleaned and simplified surface, and which triangles photos saw."""
    vertices, faces, known = extract_surface(field)
    seen = np.asarray(known[faces].all(axis=1))
    seen_faces = faces[seen]
    main = main_parts(vertices, seen_faces, np.ones(len(seen_faces), bool))
    if main.sum() < _MIN_TRIANGLES:
        raise ObjectError(
            f"This object is too small or too loose for a mesh: its surface has {int(main.sum())} triangles. "
            "Export its Gaussians instead."
        )
    vertices, faces, known = extract_surface(with_unseen_filled(field, vertices[np.unique(seen_faces[main])]))
    seen = np.asarray(known[faces].all(axis=1))
    kept = kept_faces(vertices, faces, seen, watertight=settings.watertight)
    vertices, faces = used_vertices(vertices, faces[kept])
    vertices, faces, seen = simplified(
        vertices, faces, seen[kept], triangles=settings.triangles, closed=settings.watertight
    )
    return separated(vertices, faces) if settings.watertight else vertices, faces, seen


def _no_atlas(vertices: Float64, faces: Int32) -> tuple[Int32, Int32, Float32]:
    """Return what `make_atlas` does, for a mesh without a texture."""
    return np.arange(len(vertices), dtype=np.int32), faces, np.zeros((len(vertices), 2), np.float32)


def _points(
    vertices: Float64, faces: Int32, normals: Float32, seen: Mask, numbers: Int32, weights: Float32
) -> SurfacePoints:
    """Return the points of the texture's pixels, then the vertices."""
    places = _between(vertices.astype(np.float32), faces[numbers], weights)
    vertex_seen = np.zeros(len(vertices), bool)
    vertex_seen[faces[seen].ravel()] = True
    return SurfacePoints(
        np.concatenate([places, vertices.astype(np.float32)]),
        np.concatenate([normalized(_between(normals, faces[numbers], weights)), normals]),
        np.concatenate([seen[numbers], vertex_seen]),
    )


def _between(values: Float32, corners: Int32, weights: Float32) -> Float32:
    """Return values of vertices, [V, K], between the three `corners` [P, 3], [P, K]."""
    result = values[corners[:, 0]] * (1 - weights.sum(axis=1, keepdims=True))
    result += values[corners[:, 1]] * weights[:, :1]
    result += values[corners[:, 2]] * weights[:, 1:]
    return result


def _texture(
    side: int,
    numbers: Int32,
    weights: Float32,
    faces: Int32,
    vertex_colors: Float32,
    where: tuple[Any, Any],
    colors: Float32,
    known: Mask,
) -> Pixels:
    """Return the texture, [side, side, 4]; alpha is 0 where no photo gave a colour."""
    if not side:
        return np.zeros((0, 0, 4), np.uint8)
    filled = _between(vertex_colors, faces[numbers[where]], weights[where])
    texture = np.zeros((side, side, 4), np.uint8)
    texture[where[0], where[1], :3] = np.rint(255 * np.where(known[:, None], colors, filled))
    texture[where[0], where[1], 3] = np.where(known, 255, 0)
    # What lies between the parts gets the nearest colour, as smaller pictures mix it in.
    empty = numbers < 0
    _, labels = cv2.distanceTransformWithLabels(empty.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    source = np.zeros((int(labels.max()) + 1, 4), np.uint8)
    source[labels[~empty]] = texture[~empty]
    return source[labels]
