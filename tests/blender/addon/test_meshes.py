"""The mesh of an object: asked of the engine, and put beside the splats with its material."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

Part = Callable[[str], ModuleType]
StandIn = Callable[[str], Path]


def png() -> bytes:
    """Return a picture of 2 x 2 pixels, as PNG."""
    rows = b"".join(b"\0" + bytes([200, 100, 50, 255] * 2) for _ in range(2))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 2, 2, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def write_pyramid(part: Part, file: Path) -> np.ndarray:
    """Write a mesh as the engine does, in the normalised world, and return its vertices there."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32) + np.float32(0.25)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)
    normals = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    uv = np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]] * 4, np.float32)
    mesh = part("engine.scene").Mesh(
        vertices, faces, np.arange(4) > 0, np.zeros((4, 3), np.uint8), normals, faces.ravel(), uv,
        np.arange(12, dtype=np.int32).reshape(4, 3), np.zeros((2, 2, 4), np.uint8),
    )  # fmt: skip
    formats = part("engine.formats")
    file.parent.mkdir(parents=True, exist_ok=True)
    formats.write_mesh(file, mesh, "glb-mesh", formats.FileFacts(up="z"), png())
    return vertices


def corners(mesh: bpy.types.Object) -> np.ndarray:
    """Return where the vertices of an object are in the world, in the order of their coordinates."""
    places = [tuple(round(value, 4) for value in mesh.matrix_world @ vertex.co) for vertex in mesh.data.vertices]
    return np.array(sorted(set(places)))


def test_mesh_is_asked_of_the_engine_and_stands_where_the_splats_stand(
    opened: Any, fake_engine: StandIn, part: Part, project: Any
) -> None:
    splats = bpy.data.objects["Vase"]
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    file = part("gaussian_heritage_addon.project.object_mesh").mesh_file(Path(project.folder), "vase")
    vertices = write_pyramid(part, file)
    arguments = fake_engine(f"say('finished', outputs={{'object': 'vase', 'file': {str(file)!r}}})")
    assert bpy.ops.heritage.make_mesh(watertight=True) == {"FINISHED"}
    assert {"--watertight", "--object=vase", "--format=glb-mesh"} <= set(
        json.loads(arguments.read_text(encoding="utf-8"))
    )
    (mesh,) = [one for one in splats.children if one.type == "MESH" and one.name.startswith("Vase mesh")]
    assert mesh.users_collection[0] in tuple(splats.users_collection)
    frame = part("gaussian_heritage_addon.splats.splats").SplatScene.of(splats).frame
    bpy.context.view_layer.update()
    world = np.array(splats.matrix_world) @ frame
    expected = vertices @ world[:3, :3].T + world[:3, 3]
    np.testing.assert_allclose(corners(mesh), np.array(sorted(map(tuple, expected))), atol=1e-3)
    assert {one.name.split(".")[0] for one in mesh.data.materials} == {"photographed", "filled_seen_by_no_photo"}
    splats.location.x += 5
    bpy.context.view_layer.update()
    np.testing.assert_allclose(corners(mesh)[:, 0], np.array(sorted(map(tuple, expected)))[:, 0] + 5, atol=1e-3)
    # A second mesh replaces the first one.
    assert bpy.ops.heritage.make_mesh() == {"FINISHED"}
    assert len([one for one in splats.children if one.name.startswith("Vase mesh")]) == 1


def test_mesh_needs_an_object_that_is_stored_as_it_is_shown(opened: Any, fake_engine: StandIn) -> None:
    bpy.context.scene.heritage.active = -1
    with pytest.raises(RuntimeError, match="Select an isolated object in the list first"):
        bpy.ops.heritage.make_mesh()
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    bpy.data.objects["Vase"].heritage.is_edited = True
    with pytest.raises(RuntimeError, match="Vase was edited by hand"):
        bpy.ops.heritage.make_mesh()


def test_file_that_is_no_mesh_is_refused_in_a_sentence(
    opened: Any, fake_engine: StandIn, part: Part, project: Any
) -> None:
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    file = part("gaussian_heritage_addon.project.object_mesh").mesh_file(Path(project.folder), "vase")
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(b"glTF of somebody else")
    fake_engine(f"say('finished', outputs={{'object': 'vase', 'file': {str(file)!r}}})")
    with pytest.raises(RuntimeError, match="Make the mesh again"):
        bpy.ops.heritage.make_mesh()
