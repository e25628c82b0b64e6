"""The mesh of an object: asked of the engine, put beside the splats with its material, and exported to files."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import FakeLayout, Part, StandIn, isolated, write_object


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
    # Blender has it: nothing is left in the project that a deletion in Blender would forget.
    assert not file.exists()
    # A second mesh replaces the first one.
    write_pyramid(part, file)
    assert bpy.ops.heritage.make_mesh() == {"FINISHED"}
    assert len([one for one in splats.children if one.name.startswith("Vase mesh")]) == 1


def test_mesh_needs_an_object_that_is_stored_as_it_is_shown(opened: Any, fake_engine: StandIn) -> None:
    bpy.context.scene.heritage.active = -1
    with pytest.raises(RuntimeError, match="Select an isolated object in the list first"):
        bpy.ops.heritage.make_mesh()
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    bpy.data.objects["Vase"].heritage.is_edited = True
    with pytest.raises(RuntimeError, match="Vase is not stored as it is shown"):
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


@pytest.fixture
def meshed(opened: Any, fake_engine: StandIn, part: Part) -> bpy.types.Object:
    """Return the mesh that was made of the vase."""
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    file = part("gaussian_heritage_addon.project.object_mesh").mesh_file(Path(opened.folder), "vase")
    write_pyramid(part, file)
    fake_engine(f"say('finished', outputs={{'object': 'vase', 'file': {str(file)!r}}})")
    assert bpy.ops.heritage.make_mesh() == {"FINISHED"}
    bpy.context.scene.heritage.show = "OBJECTS"
    return mesh_of("Vase")


def mesh_of(name: str) -> bpy.types.Object:
    (mesh,) = [one for one in bpy.data.objects[name].children if one.get("heritage_mesh_of")]
    return mesh


def test_saved_mesh_keeps_its_texture_and_is_replaced_after_reopening(
    meshed: Any, opened: Any, part: Part, tmp_path: Path
) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "room.blend"))
    materials = mesh_of("Vase").data.materials
    (image,) = {node.image for one in materials for node in one.node_tree.nodes if node.type == "TEX_IMAGE"}
    assert image.packed_file is not None and tuple(image.size) == (2, 2)
    write_pyramid(part, part("gaussian_heritage_addon.project.object_mesh").mesh_file(Path(opened.folder), "vase"))
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    assert bpy.ops.heritage.make_mesh() == {"FINISHED"}
    assert mesh_of("Vase").name == "Vase mesh"


def test_deleted_object_takes_its_mesh_with_it_and_undo_brings_both_back(meshed: Any) -> None:
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.heritage.delete_object() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="deleted")
    assert not isolated() and "Vase mesh" not in bpy.data.objects
    bpy.ops.ed.undo()
    assert mesh_of("Vase").name == "Vase mesh"


def test_appended_object_brings_its_mesh(meshed: Any, tmp_path: Path) -> None:
    (collection,) = bpy.data.objects["Vase"].users_collection
    name, file = collection.name, tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    bpy.ops.wm.append(directory=f"{file}/Collection/", filename=name)
    assert len(mesh_of("Vase").data.polygons) == 4


def test_mesh_is_hidden_with_what_is_not_shown(meshed: Any, part: Part) -> None:
    scene = bpy.context.scene
    assert meshed.visible_get() and not meshed.hide_render
    scene.heritage.show = "SCENE"
    assert meshed.hide_viewport and meshed.hide_render
    scene.heritage.show = "OBJECTS"
    assert meshed.visible_get()
    write_object(Path(scene.heritage.project), "cup", "Cup", (np.arange(100) >= 70).astype(np.float32))
    part("gaussian_heritage_addon.project.scene_file").add_objects(scene, Path(scene.heritage.project), ["cup"])
    scene.heritage.active = bpy.data.objects.find("Cup")
    assert bpy.ops.heritage.solo_object() == {"FINISHED"}
    assert meshed.hide_get() and meshed.hide_render
    assert bpy.ops.heritage.solo_object() == {"FINISHED"}
    assert meshed.visible_get() and not meshed.hide_render
    # The eye of the splats alone leaves the mesh.
    isolated()["vase"].heritage.hidden = True
    assert meshed.visible_get()


@pytest.mark.parametrize("origin", ["WORLD", "OBJECT"])
def test_exported_mesh_is_asked_of_the_engine_where_the_splats_stand(
    opened: Any, fake_engine: StandIn, part: Part, tmp_path: Path, origin: str
) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    vase, out = isolated()["vase"], tmp_path / "out"
    vase.heritage.catalogue_number = "1906/12"
    vase.location, vase.scale = (3, -4, 5), (2, 2, 2)
    bpy.context.view_layer.update()
    arguments = fake_engine("say('finished', outputs={})")
    options = {"triangles": "5000", "watertight": True, "origin": origin, "overwrite": True, "with_record": False}
    assert bpy.ops.heritage.export_objects(directory=str(out), format="USD_MESH", **options) == {"FINISHED"}
    words = json.loads(arguments.read_text(encoding="utf-8"))
    assert {
        "export", "--object=vase", "--format=usd-mesh", "--triangles=5000", "--watertight", "--overwrite",
        "--record=none", "--unit=unknown", f"--out={out / '1906_12 Vase.usdz'}", str(opened.folder),
    } <= set(words)  # fmt: skip
    (placement,) = [word.partition("=")[2] for word in words if word.startswith("--placement=")]
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.of(vase)
    expected = np.array(vase.matrix_world, float)
    if origin == "OBJECT":
        expected[:3, 3] = 0
    np.testing.assert_allclose(
        np.array(placement.split(","), float).reshape(4, 4), expected @ splats.frame, rtol=1e-6, atol=1e-6
    )


def test_mesh_of_a_measured_scene_is_exported_in_metres(
    opened: Any, fake_engine: StandIn, part: Part, tmp_path: Path
) -> None:
    scene = part("engine.scene")
    distances = (scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0),)
    part("gaussian_heritage_addon.project.measuring").measure(bpy.context.scene, scene.Measurement(distances))
    arguments = fake_engine("say('finished', outputs={})")
    bpy.ops.heritage.export_objects(directory=str(tmp_path / "out"), format="STL")
    assert "--unit=metre" in json.loads(arguments.read_text(encoding="utf-8"))


def test_formats_of_meshes_are_those_of_the_table_and_show_their_options_alone(opened: Any, part: Part) -> None:
    offered = {one.name for one in part("engine.formats").FORMATS if one.write_mesh is not None}
    kinds = part("operators.export_objects")._KINDS
    assert offered == {one.name for one in kinds.values() if one.write_mesh is not None}
    operator = bpy.types.HERITAGE_OT_export_objects
    for name, kind in kinds.items():
        layout, options = FakeLayout(), {"format": name, "scope": "SCENE"}
        names = ("format", "triangles", "watertight", "scope", "origin", "with_record", "with_far", "overwrite")
        shown = SimpleNamespace(
            layout=layout, bl_rna=SimpleNamespace(properties=dict.fromkeys(names)), _chosen=lambda context: ([], []),
            **options,
        )  # fmt: skip
        operator.draw(shown, bpy.context)
        is_mesh = kind.write_mesh is not None
        assert ("triangles" in layout.props, "watertight" in layout.props, "with_far" in layout.props) == (
            is_mesh, is_mesh, not is_mesh,
        )  # fmt: skip


def test_export_of_what_has_no_mesh_is_refused_in_a_sentence(opened: Any, fake_engine: StandIn, tmp_path: Path) -> None:
    arguments, out = fake_engine("say('finished', outputs={})"), tmp_path / "out"

    def export(**options: Any) -> None:
        bpy.ops.heritage.export_objects(**{"directory": str(out), "format": "OBJ", **options})

    with pytest.raises(RuntimeError, match="is no isolated object of a project"):
        export(scope="SCENE")
    isolated()["vase"].heritage.threshold = 0.7
    with pytest.raises(RuntimeError, match="Vase is not stored as it is shown"):
        export()
    isolated()["vase"].heritage.threshold = 0.5
    out.mkdir()
    (out / "Vase.mtl").write_text("precious")
    with pytest.raises(RuntimeError, match=r"already contains Vase\.mtl"):
        export()
    assert not arguments.exists()
    with pytest.raises(RuntimeError, match="too transparent"):
        fake_engine("say('error', type='ObjectError', message='It is too transparent.')\nsys.exit(2)")
        export(overwrite=True)
