# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural meshes: turned profiles, swept tubes, bevelled boxes and height fields. Units: metres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import radians

import bmesh
import bpy
import numpy as np

from . import shapes
from .shapes import Point2, Point3, Shape, smooth

__all__ = ["Point2", "Point3", "box", "from_arrays", "from_shape", "lathe", "link", "quad", "relief", "smooth", "tube"]


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


def from_shape(name: str, shape: Shape, material: bpy.types.Material) -> bpy.types.Object:
    """Create a smooth-shaded object of a shape. Quads with two equal corners become triangles."""
    quads = shape.quads.tolist()
    faces: list[Sequence[int]] = [quad if quad[3] != quad[2] else quad[:3] for quad in quads]
    uvs = None
    if shape.uvs is not None:
        uvs = [corners[: len(face)] for corners, face in zip(shape.uvs.tolist(), faces, strict=True)]
        uvs += [[at] * len(cap) for cap, at in zip(shape.caps, shape.cap_uvs, strict=True)]
    return from_arrays(name, shape.vertices, [*faces, *shape.caps], uvs, material, shape.crease)


def lathe(
    name: str,
    profile: Sequence[Sequence[float]],
    material: bpy.types.Material,
    segments: int = 80,
    planar: bool = False,
) -> bpy.types.Object:
    """Create a solid of revolution of a profile; see `shapes.lathe`."""
    return from_shape(name, shapes.lathe(profile, segments, planar), material)


def tube(
    name: str,
    path: Sequence[Point3],
    radii: float | Sequence[float],
    material: bpy.types.Material,
    sides: int = 16,
    flatten: float = 1.0,
) -> bpy.types.Object:
    """Sweep a circle or an ellipse along a path; see `shapes.tube`."""
    return from_shape(name, shapes.tube(path, radii, sides, flatten), material)


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
    """Create a textured rectangle; see `shapes.quad`."""
    return from_shape(name, shapes.quad(corners, repeat), material)


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
