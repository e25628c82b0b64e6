"""Meshes as glTF 2.0 binary: one mesh, two materials with one texture, and which vertices photos saw."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..core.errors import FormatError
from ..core.files import atomic_write
from ..scene import Mesh
from .glb import BIN_CHUNK, JSON_CHUNK, MAGIC, MAX_FILE_SIZE, XMP
from .mesh_plain import FILLED_MATERIAL, SEEN_MATERIAL

MESH_ROUGHNESS = 0.9
"""Roughness of both materials: photos do not measure it, and the colours contain the light of the room."""

_FLOAT, _UINT, _ARRAY_BUFFER, _INDEX_BUFFER = 5126, 5125, 34962, 34963
_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


def write_mesh_glb(
    path: Path,
    mesh: Mesh,
    texture: bytes,
    *,
    name: str,
    copyright: str | None = None,
    extras: Mapping[str, Any] | None = None,
    xmp: Mapping[str, Any] | None = None,
) -> None:
    """Write a mesh as a GLB, atomically.

    Parameters
    ----------
    mesh : Mesh
        In glTF's axes, Y up.
    texture : bytes
        As PNG. Its alpha, which marks what no photo saw, is not drawn: both materials are opaque.
    name, copyright, extras, xmp
        As of `write_glb`.

    Raises
    ------
    FormatError
        When the file would exceed 4 GiB.
    DiskError
        When the file cannot be written.
    """
    binary = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def add(values: NDArray[Any], kind: str, target: int) -> int:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes, "target": target})
        binary.extend(values.tobytes())
        component = _UINT if target == _INDEX_BUFFER else _FLOAT
        accessor = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        accessors.append(accessor)
        return len(accessors) - 1

    places = np.ascontiguousarray(mesh.vertices[mesh.corners], "<f4")
    attributes = {
        "POSITION": add(places, "VEC3", _ARRAY_BUFFER),
        "NORMAL": add(np.ascontiguousarray(mesh.normals[mesh.corners], "<f4"), "VEC3", _ARRAY_BUFFER),
        "TEXCOORD_0": add(np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]]).astype("<f4"), "VEC2", _ARRAY_BUFFER),
        "_SEEN": add(mesh.seen_vertices[mesh.corners].astype("<f4"), "SCALAR", _ARRAY_BUFFER),
    }
    accessors[0] |= {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    primitives = []
    for material, shown in enumerate((mesh.seen, ~mesh.seen)):
        if shown.any():
            indices = add(mesh.texture_faces[shown].astype("<u4").reshape(-1), "SCALAR", _INDEX_BUFFER)
            primitives.append({"attributes": attributes, "indices": indices, "material": material, "mode": 4})
    views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(texture)})
    binary.extend(texture + b"\0" * (-len(texture) % 4))
    asset: dict[str, Any] = {"version": "2.0", "generator": f"Gaussian Heritage {__version__}"}
    asset |= {key: value for key, value in (("copyright", copyright), ("extras", dict(extras or {}))) if value}
    surface = {
        "baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": MESH_ROUGHNESS,
    }  # fmt: skip
    document: dict[str, Any] = {
        "asset": asset,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [{"name": name, "primitives": primitives}],
        "materials": [
            # Two-sided: what no photo saw is open, and the inside of a vessel is seen through its mouth.
            {"name": one, "pbrMetallicRoughness": surface, "alphaMode": "OPAQUE", "doubleSided": True}
            for one in (SEEN_MATERIAL, FILLED_MATERIAL)[: 2 if len(primitives) > 1 or not mesh.seen.any() else 1]
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "images": [{"bufferView": len(views) - 1, "mimeType": "image/png", "name": name}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    if xmp is not None:
        document |= {"extensionsUsed": [XMP], "extensions": {XMP: {"packets": [dict(xmp)]}}}
        asset["extensions"] = {XMP: {"packet": 0}}
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    if total > MAX_FILE_SIZE:
        raise FormatError(f"{path} would take {total / 2**30:.1f} GiB; GLB is limited to 4 GiB. Take fewer triangles.")
    with atomic_write(path) as stream:
        stream.write(struct.pack("<IIIII", MAGIC, 2, total, len(text), JSON_CHUNK) + text)
        stream.write(struct.pack("<II", len(binary), BIN_CHUNK) + binary)
