"""A mesh of an object with its texture, as arrays. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32, Float64, Int32, Mask, Pixels


@dataclass(frozen=True)
class Mesh:
    """Triangles with a texture, and which of them no photo saw.

    Attributes
    ----------
    vertices : array of shape [V, 3], float32
        Positions, in world units.
    faces : array of shape [F, 3], int32
        Vertices of each triangle, counterclockwise seen from outside.
    seen : array of shape [F], bool
        Whether photos saw the triangle. The others fill what no photo saw.
    colors : array of shape [V, 3], uint8, sRGB
    normals : array of shape [V, 3], float32
        Of unit length, outward.
    corners : array of shape [U], int32
        The vertex of each place in the texture: a vertex where parts of the texture meet has several.
    uv : array of shape [U, 2], float32
        Places in the texture, 0 to 1 from its lower left corner.
    texture_faces : array of shape [F, 3], int32
        Rows of `corners` of each triangle.
    texture : array of shape [H, W, 4], uint8
        sRGB, the first row at the top. Alpha is 255 where photos saw the surface, 0 where its colour was filled in.
    """

    vertices: Float32
    faces: Int32
    seen: Mask
    colors: Pixels
    normals: Float32
    corners: Int32
    uv: Float32
    texture_faces: Int32
    texture: Pixels

    @property
    def n_filled(self) -> int:
        """Number of triangles that no photo saw."""
        return int((~self.seen).sum())

    @property
    def seen_vertices(self) -> Mask:
        """Whether photos saw each vertex, [V]: all triangles around it."""
        seen = np.ones(len(self.vertices), bool)
        seen[self.faces[~self.seen].ravel()] = False
        return seen

    @property
    def is_closed(self) -> bool:
        """Whether each edge has two triangles, which pass it in opposite directions.

        Vertices at the same place are one vertex, as programs read an STL, which has no numbers of vertices.
        """
        _, numbers = np.unique(self.vertices, axis=0, return_inverse=True)
        return are_closed(numbers.reshape(-1)[self.faces])

    @property
    def volume(self) -> float:
        """Volume that the triangles enclose, in cubic world units; only meaningful where `is_closed`."""
        a, b, c = (self.vertices[self.faces[:, k]].astype(np.float64) for k in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)

    def moved(self, matrix: Float64) -> Mesh:
        """Return the mesh after an affine transform [4, 4]. Its triangles face outward after a mirroring one, too."""
        linear = matrix[:3, :3]
        vertices = self.vertices.astype(np.float64) @ linear.T + matrix[:3, 3]
        sign = np.sign(np.linalg.det(linear))
        normals = sign * self.normals.astype(np.float64) @ np.linalg.inv(linear)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        step = int(sign)
        return replace(
            self, vertices=vertices.astype(np.float32), normals=normals.astype(np.float32),
            faces=np.ascontiguousarray(self.faces[:, ::step]),
            texture_faces=np.ascontiguousarray(self.texture_faces[:, ::step]),
        )  # fmt: skip


def are_closed(faces: NDArray[np.signedinteger]) -> bool:
    """Return whether each edge of triangles [F, 3] has two, which pass it in opposite directions; False without any."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    n = int(faces.max(initial=0)) + 1
    forth, back = np.sort(ends[:, 0] * n + ends[:, 1]), np.sort(ends[:, 1] * n + ends[:, 0])
    return len(forth) > 0 and bool((np.diff(forth) > 0).all() and (forth == back).all())
