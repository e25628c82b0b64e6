# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural meshes: turned profiles, swept tubes, bevelled boxes and height fields. Units: metres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin

import bmesh
import bpy
import numpy as np

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


def smooth(points: Sequence[Sequence[float]], steps: int = 8) -> np.ndarray:
    """Interpolate control points with a Catmull-Rom curve that passes through all of them."""
    controls = np.asarray(points, dtype=float)
    padded = np.vstack([2 * controls[0] - controls[1], controls, 2 * controls[-1] - controls[-2]])
    curve = []
    for before, start, end, after in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        for t in np.arange(steps) / steps:
            curve.append(
                0.5
                * (
                    2 * start
                    + (end - before) * t
                    + (2 * before - 5 * start + 4 * end - after) * t**2
                    + (3 * start - before - 3 * end + after) * t**3
                )
            )
    curve.append(controls[-1])
    return np.array(curve)


def from_arrays(
    name: str,
    vertices: np.ndarray,
    faces: Sequence[Sequence[int]],
    uvs: Sequence[Sequence[Point2]] | None,
    material: bpy.types.Material,
    crease: float = 40.0,
) -> bpy.types.Object:
    """Create a smooth-shaded object; edges with an angle above `crease` degrees stay sharp.

    Parameters
    ----------
    uvs
        Texture coordinates of the corners of each face.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(v) for v in vertices], [], [tuple(f) for f in faces])
    if uvs is not None:
        flat = np.array([corner for face in uvs for corner in face], dtype=np.float32)
        mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", flat.ravel())
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.set_sharp_from_angle(angle=radians(crease))
    mesh.materials.append(material)
    return link(name, mesh)


def link(name: str, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Create an object of a mesh in the scene."""
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def lathe(
    name: str,
    profile: Sequence[Sequence[float]],
    material: bpy.types.Material,
    segments: int = 80,
    planar: bool = False,
) -> bpy.types.Object:
    """Create a solid of revolution of a profile of (radius, height) points around Z.

    Parameters
    ----------
    planar
        Whether the texture is projected from above (for discs) instead of around the side with v along the height.
    """
    profile = np.asarray(profile, dtype=float)
    angles = np.linspace(0, 2 * pi, segments, endpoint=False)
    radius, height = profile[:, 0:1], profile[:, 1:2]
    rings = np.stack([radius * np.cos(angles), radius * np.sin(angles), height + 0 * angles], axis=-1)
    vertices = rings.reshape(-1, 3)
    v = (profile[:, 1] - profile[:, 1].min()) / max(np.ptp(profile[:, 1]), 1e-9)
    widest = 2 * profile[:, 0].max()
    faces, uvs = [], []
    for i in range(len(profile) - 1):
        for j in range(segments):
            k = (j + 1) % segments
            corners = (i * segments + j, i * segments + k, (i + 1) * segments + k, (i + 1) * segments + j)
            faces.append(corners)
            if planar:
                uvs.append([(vertices[c][0] / widest + 0.5, vertices[c][1] / widest + 0.5) for c in corners])
            else:
                uvs.append(
                    [
                        (j / segments, v[i]),
                        ((j + 1) / segments, v[i]),
                        ((j + 1) / segments, v[i + 1]),
                        (j / segments, v[i + 1]),
                    ]
                )
    return from_arrays(name, vertices, faces, uvs, material)


def tube(
    name: str,
    path: Sequence[Point3],
    radii: float | Sequence[float],
    material: bpy.types.Material,
    sides: int = 16,
    flatten: float = 1.0,
) -> bpy.types.Object:
    """Sweep a circle, or an ellipse with its binormal axis scaled by `flatten`, along a path and close the ends."""
    path = np.asarray(path, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(path))
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normal = np.cross(tangents[0], (0.0, 0.0, 1.0) if abs(tangents[0][2]) < 0.9 else (1.0, 0.0, 0.0))
    rings = []
    for centre, radius, tangent in zip(path, radii, tangents, strict=True):
        # The normal follows from the previous one, so that the tube does not twist where the path bends.
        normal = normal - tangent * normal.dot(tangent)
        normal /= np.linalg.norm(normal)
        binormal = np.cross(tangent, normal) * flatten
        rings.append(
            [
                centre + radius * (cos(a) * normal + sin(a) * binormal)
                for a in np.linspace(0, 2 * pi, sides, endpoint=False)
            ]
        )
    faces, uvs = [], []
    for i in range(len(path) - 1):
        for j in range(sides):
            k = (j + 1) % sides
            faces.append((i * sides + j, i * sides + k, (i + 1) * sides + k, (i + 1) * sides + j))
            u, v, u2, v2 = j / sides, i / len(path), (j + 1) / sides, (i + 1) / len(path)
            uvs.append([(u, v), (u2, v), (u2, v2), (u, v2)])
    last = (len(path) - 1) * sides
    faces += [tuple(range(sides))[::-1], tuple(range(last, last + sides))]
    uvs += [[(0.0, 0.0)] * sides, [(1.0, 1.0)] * sides]
    return from_arrays(name, np.concatenate(rings), faces, uvs, material)


def box(
    name: str, size: Point3, centre: Point3, material: bpy.types.Material, bevel: float = 0.006
) -> bpy.types.Object:
    """Create a box with bevelled edges."""
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=1.0)
    bmesh.ops.scale(shape, vec=size, verts=shape.verts)
    if bevel:
        bmesh.ops.bevel(shape, geom=shape.edges[:], offset=bevel, segments=2, affect="EDGES", profile=0.6)
    bmesh.ops.translate(shape, vec=centre, verts=shape.verts)
    mesh = bpy.data.meshes.new(name)
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(material)
    return link(name, mesh)


def quad(
    name: str,
    corners: Sequence[Point3],
    material: bpy.types.Material,
    repeat: Point2 = (1.0, 1.0),
) -> bpy.types.Object:
    """Create a textured rectangle; the corners start at the texture's lower left, counter-clockwise."""
    u, v = repeat
    return from_arrays(name, np.array(corners), [(0, 1, 2, 3)], [[(0, 0), (u, 0), (u, v), (0, v)]], material)


def relief(
    name: str,
    depth: Callable[[np.ndarray, np.ndarray], np.ndarray],
    inside: Callable[[np.ndarray, np.ndarray], np.ndarray],
    half_width: float,
    half_height: float,
    thickness: float,
    material: bpy.types.Material,
    cells: int = 120,
) -> bpy.types.Object:
    """Create a height field that faces -Y, restricted to where `inside` is true, with a solid rim.

    Parameters
    ----------
    depth, inside
        Functions of x and z, both in -1..1; depth is in metres towards the viewer.
    """
    axis = np.linspace(-1, 1, cells + 1)
    x, z = np.meshgrid(axis, axis)
    vertices = np.stack([x * half_width, -depth(x, z), z * half_height], axis=-1).reshape(-1, 3)
    middle = (axis[1:] + axis[:-1]) / 2
    keep = inside(*np.meshgrid(middle, middle))
    faces, uvs = [], []
    for row, column in np.argwhere(keep):
        a = row * (cells + 1) + column
        faces.append((a, a + 1, a + cells + 2, a + cells + 1))
        u, v, step = column / cells, row / cells, 1 / cells
        uvs.append([(u, v), (u + step, v), (u + step, v + step), (u, v + step)])
    made = from_arrays(name, vertices, faces, uvs, material, crease=60)
    shape = bmesh.new()
    shape.from_mesh(made.data)
    bmesh.ops.delete(shape, geom=[v for v in shape.verts if not v.link_faces], context="VERTS")
    for _ in range(3):  # smooth the boundary, which follows the grid in steps
        edge = [v for v in shape.verts if v.is_boundary]
        bmesh.ops.smooth_vert(shape, verts=edge, factor=0.5, use_axis_x=True, use_axis_z=True)
    shape.to_mesh(made.data)
    shape.free()
    solid = made.modifiers.new("Solidify", "SOLIDIFY")
    solid.thickness, solid.offset = thickness, -1
    return made
