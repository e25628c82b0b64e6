"""The places of triangles in a texture, and which triangle each pixel of the texture shows."""

from __future__ import annotations

import numpy as np
import xatlas
from numba import njit

from ..core.arrays import Float32, Float64, Int32
from ..rasterizer import JIT
from .cleaning import areas_of

_PADDING = 3
"""Pixels between parts of the texture: smaller pictures of it mix neighbours."""

_MIN_CHARTS, _CHART_TRIANGLES = 128, 400
"""Parts of the texture of a surface, at least, and triangles of a part, at most. Growing larger ones takes five times
as long and saves few seams."""


def make_atlas(vertices: Float64, faces: Int32, side: int) -> tuple[Int32, Int32, Float32]:
    """Return places for all triangles in a square texture of `side` pixels.

    Returns
    -------
    corners : array of shape [U], int32
        The vertex of each place.
    texture_faces : array of shape [F, 3], int32
        Rows of `corners`, in the order of `faces`.
    uv : array of shape [U, 2], float32
        Columns and rows divided by `side`, from the upper left corner.
    """
    # xatlas places no triangles of less than 1e-7: a triangle of the mean area has 1 here.
    unit = float(np.sqrt(areas_of(vertices, faces).mean()))
    scaled = (vertices - vertices.mean(axis=0)) / unit
    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(scaled, np.float32), np.ascontiguousarray(faces, np.uint32))
    charts, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    charts.max_chart_area = min(len(faces) / _MIN_CHARTS, _CHART_TRIANGLES)
    packing.padding, packing.resolution = _PADDING, side
    atlas.generate(charts, packing)
    corners, texture_faces, uv = atlas[0]
    # Packed to about `side` pixels; what is larger or not square is scaled to it.
    scale = np.array([atlas.width, atlas.height]) / max(atlas.width, atlas.height)
    return corners.astype(np.int32), texture_faces.astype(np.int32), (uv * scale).astype(np.float32)


def texels(uv: Float32, texture_faces: Int32, side: int) -> tuple[Int32, Float32]:
    """Return the triangle of each pixel of the texture and where in it the pixel's middle is.

    Returns
    -------
    faces : array of shape [side, side], int32
        -1 where none is.
    weights : array of shape [side, side, 2], float32
        Of the second and third corner.
    """
    numbers = np.full((side, side), -1, np.int32)
    weights = np.zeros((side, side, 2), np.float32)
    _fill(uv.astype(np.float64) * side, texture_faces, numbers, weights)
    return numbers, weights


@njit(**JIT)
def _fill(places, faces, numbers, weights):  # type: ignore[no-untyped-def]
    height, width = numbers.shape
    for face in range(len(faces)):
        ax, ay = places[faces[face, 0]]
        bx, by = places[faces[face, 1]]
        cx, cy = places[faces[face, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        left, right = max(0, int(min(ax, bx, cx) - 0.5)), min(width - 1, int(max(ax, bx, cx) + 0.5))
        top, bottom = max(0, int(min(ay, by, cy) - 0.5)), min(height - 1, int(max(ay, by, cy) + 0.5))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                x, y = column + 0.5, row + 0.5
                s = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                t = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if s >= 0 and t >= 0 and s + t <= 1:
                    numbers[row, column] = face
                    weights[row, column, 0] = s
                    weights[row, column, 1] = t
