"""Meshes as PLY, STL and OBJ, whose files have no place for materials, units or marks of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..core.arrays import Float32, Int32
from ..core.errors import FormatError
from ..core.files import atomic_write, write_file
from ..core.visible_text import visible
from ..scene import Mesh
from .facts import FileFacts
from .ply import ascii_text

SEEN_MATERIAL, FILLED_MATERIAL = "photographed", "filled_seen_by_no_photo"
"""Names of the two materials of a mesh, in all formats that have materials."""

_STL_HEADER = 80
_LINES_PER_CHUNK = 1 << 16


def write_mesh_ply(path: Path, mesh: Mesh, facts: FileFacts, texture: bytes) -> None:
    """Write a mesh as binary PLY, atomically, with colours and with ``seen`` (1 or 0) of vertices and triangles.

    Parameters
    ----------
    mesh : Mesh
        In the frame of the file.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    rows = np.empty(
        len(mesh.vertices),
        [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
        + [(name, "u1") for name in ("red", "green", "blue", "seen")],
    )
    for k, name in enumerate(("x", "y", "z")):
        rows[name], rows[f"n{name}"] = mesh.vertices[:, k], mesh.normals[:, k]
    for k, name in enumerate(("red", "green", "blue")):
        rows[name] = mesh.colors[:, k]
    rows["seen"] = mesh.seen_vertices
    faces = np.empty(len(mesh.faces), [("n", "u1"), ("corners", "<i4", 3), ("seen", "u1")])
    faces["n"], faces["corners"], faces["seen"] = 3, mesh.faces, mesh.seen
    lines = ["ply", "format binary_little_endian 1.0", *_comments(facts.comments)]
    lines += [f"element vertex {len(rows)}"]
    lines += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue", "seen")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "property uchar seen"]
    with atomic_write(path) as stream:
        stream.write(("\n".join([*lines, "end_header"]) + "\n").encode("ascii"))
        stream.write(rows.tobytes())
        stream.write(faces.tobytes())


def write_mesh_stl(path: Path, mesh: Mesh, facts: FileFacts, texture: bytes) -> None:
    """Write a mesh as binary STL, atomically. Its header says the unit and how many triangles no photo saw.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    # Programs for printing take the numbers of an STL for millimetres.
    scale, unit = (1.0, "unknown") if facts.metres_per_unit is None else (1000 * facts.metres_per_unit, "millimetre")
    mesh = mesh.moved(np.diag([scale, scale, scale, 1.0]))
    text = f"Gaussian Heritage {__version__}; unit: {unit}; {mesh.n_filled} of {len(mesh.faces)} filled"
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    rows["corners"] = corners
    with atomic_write(path) as stream:
        stream.write(text.encode("ascii", "replace")[:_STL_HEADER].ljust(_STL_HEADER))
        stream.write(np.uint32(len(rows)).astype("<u4").tobytes())
        stream.write(rows.tobytes())


def write_mesh_obj(path: Path, mesh: Mesh, facts: FileFacts, texture: bytes) -> None:
    """Write a mesh as OBJ with its material (``.mtl``) and texture (``.png``) beside it. The OBJ is written last.

    Parameters
    ----------
    texture : bytes
        As PNG.

    Raises
    ------
    FormatError
        When the name of the file has letters that the lines of an OBJ cannot refer to.
    DiskError
        When a file cannot be written.
    """
    if any(letter.isspace() for letter in path.stem):
        raise FormatError(f"{path.name} has a space, with which programs do not find its texture. Choose another name.")
    material, picture = path.with_suffix(".mtl"), path.with_suffix(".png")
    write_file(picture, texture)
    with atomic_write(material, "w") as stream:
        for one in (SEEN_MATERIAL, FILLED_MATERIAL):
            stream.write(f"newmtl {one}\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture.name}\n")
    with atomic_write(path, "w") as stream:
        stream.writelines(f"# {visible(line)}\n" for line in (f"Gaussian Heritage {__version__}", *facts.comments))
        stream.write(f"mtllib {material.name}\no {'_'.join(visible(facts.name).split()) or 'mesh'}\n")
        _write_rows(stream, "v", mesh.vertices)
        _write_rows(stream, "vt", mesh.uv)
        _write_rows(stream, "vn", mesh.normals)
        for one, shown in ((SEEN_MATERIAL, mesh.seen), (FILLED_MATERIAL, ~mesh.seen)):
            if shown.any():
                stream.write(f"usemtl {one}\n")
                _write_faces(stream, mesh.faces[shown] + 1, mesh.texture_faces[shown] + 1)


def _comments(comments: Sequence[str]) -> list[str]:
    return [f"comment {ascii_text(' '.join(one.split()))}" for one in comments]


def _write_rows(stream: Any, key: str, rows: Float32) -> None:
    for start in range(0, len(rows), _LINES_PER_CHUNK):
        part = rows[start : start + _LINES_PER_CHUNK].tolist()
        stream.write("".join(f"{key} {' '.join(f'{value:.7g}' for value in row)}\n" for row in part))


def _write_faces(stream: Any, faces: Int32, places: Int32) -> None:
    for start in range(0, len(faces), _LINES_PER_CHUNK):
        rows = np.stack([faces, places], axis=2)[start : start + _LINES_PER_CHUNK].tolist()
        stream.write("".join(f"f {' '.join(f'{v}/{t}/{v}' for v, t in row)}\n" for row in rows))
