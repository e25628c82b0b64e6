"""Meshes as glTF 2.0 binary: one mesh, two materials with one texture, and which vertices photos saw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene import Mesh
from .facts import FileFacts
from .gltf import ARRAY_BUFFER, FLOAT, INDEX_BUFFER, UINT, document_of, write_parts
from .mesh_plain import FILLED_MATERIAL, SEEN_MATERIAL

MESH_ROUGHNESS = 0.9
"""Roughness of both materials: photos do not measure it, and the colours contain the light of the room."""

_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


def write_mesh_glb(path: Path, mesh: Mesh, facts: FileFacts, texture: bytes) -> None:
    """Write a mesh as a GLB, atomically.

    Parameters
    ----------
    mesh : Mesh
        In glTF's axes, Y up.
    texture : bytes
        As PNG. Its alpha, which marks what no photo saw, is not drawn: both materials are opaque.

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
        component = UINT if target == INDEX_BUFFER else FLOAT
        accessor = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        accessors.append(accessor)
        return len(accessors) - 1

    places = np.ascontiguousarray(mesh.vertices[mesh.corners], "<f4")
    attributes = {
        "POSITION": add(places, "VEC3", ARRAY_BUFFER),
        "NORMAL": add(np.ascontiguousarray(mesh.normals[mesh.corners], "<f4"), "VEC3", ARRAY_BUFFER),
        "TEXCOORD_0": add(np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]]).astype("<f4"), "VEC2", ARRAY_BUFFER),
        "_SEEN": add(mesh.seen_vertices[mesh.corners].astype("<f4"), "SCALAR", ARRAY_BUFFER),
    }
    accessors[0] |= {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    primitives = []
    for material, shown in enumerate((mesh.seen, ~mesh.seen)):
        if shown.any():
            indices = add(mesh.texture_faces[shown].astype("<u4").reshape(-1), "SCALAR", INDEX_BUFFER)
            primitives.append({"attributes": attributes, "indices": indices, "material": material, "mode": 4})
    views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(texture)})
    binary.extend(texture + b"\0" * (-len(texture) % 4))
    surface = {
        "baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": MESH_ROUGHNESS,
    }  # fmt: skip
    document = document_of(facts)
    document["nodes"][0]["mesh"] = 0
    document |= {
        "meshes": [{"name": facts.name, "primitives": primitives}],
        "materials": [
            # Two-sided: what no photo saw is open, and the inside of a vessel is seen through its mouth.
            {"name": one, "pbrMetallicRoughness": surface, "alphaMode": "OPAQUE", "doubleSided": True}
            for one in (SEEN_MATERIAL, FILLED_MATERIAL)[: 2 if len(primitives) > 1 or not mesh.seen.any() else 1]
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "images": [{"bufferView": len(views) - 1, "mimeType": "image/png", "name": facts.name}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    write_parts(path, document, [binary], len(binary), "Take fewer triangles.")
