"""Export writes what is meant: named after the record, only what is shown, in formats that can be written."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import FakeLayout, Part, isolated, write_object


@pytest.fixture
def room(opened: Any, part: Part) -> Any:
    """Return the opened project with a vase, a teapot whose eye is closed, and a background."""
    rows = np.arange(100)
    write_object(opened.folder, "teapot", "Teapot", (rows >= 70).astype(np.float32))
    write_object(
        opened.folder, "background", "Background", (rows >= 90).astype(np.float32), prompt={"kind": "background"}
    )
    part("gaussian_heritage_addon.project.scene_file").add_objects(
        bpy.context.scene, opened.folder, ["teapot", "background"]
    )
    isolated()["teapot"].heritage.hidden = True
    assert isolated()["background"].heritage.kind == "background"
    return opened


def export(folder: Path, **options: Any) -> set[str]:
    assert bpy.ops.heritage.export_objects(directory=str(folder), **options) == {"FINISHED"}
    return {file.name for file in folder.iterdir()}


def test_the_default_is_glb_of_the_objects_that_are_shown(room: Any, tmp_path: Path, capfd: Any) -> None:
    assert export(tmp_path / "out") == {"Vase.glb"}
    said = capfd.readouterr().out
    assert "Wrote 1 file: Vase.glb." in said
    assert "Teapot (hidden)" in said and "Background (background)" in said


@pytest.mark.parametrize("show", ["SCENE", "OBJECTS"])
def test_hidden_objects_and_the_background_are_exported_when_chosen(room: Any, tmp_path: Path, show: str) -> None:
    bpy.context.scene.heritage.show = show
    assert export(tmp_path / "a", with_hidden=True) == {"Vase.glb", "Teapot.glb"}
    assert export(tmp_path / "b", with_background=True) == {"Vase.glb", "Background.glb"}


def test_an_eye_that_is_closed_in_the_outliner_counts(room: Any, tmp_path: Path) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    isolated()["teapot"].heritage.hidden = False
    isolated()["vase"].hide_set(True)
    assert export(tmp_path / "out") == {"Teapot.glb"}
    isolated()["teapot"].users_collection[0].hide_viewport = True
    with pytest.raises(RuntimeError, match="All 3 objects are hidden"):
        bpy.ops.heritage.export_objects(directory=str(tmp_path / "none"))


def test_the_file_browser_says_how_many_objects_are_exported_and_which(room: Any, part: Part) -> None:
    operator, layout = bpy.types.HERITAGE_OT_export_objects, FakeLayout()
    options = {"format": "GLB", "scope": "ALL", "with_hidden": False, "with_background": False}
    names = ("format", "scope", "with_hidden", "with_background", "origin", "with_record", "with_far", "overwrite")
    shown = SimpleNamespace(
        layout=layout,
        bl_rna=SimpleNamespace(properties=dict.fromkeys(names)),
        _chosen=lambda context: operator._chosen(SimpleNamespace(**options), context),
        **options,
    )
    operator.draw(shown, bpy.context)
    assert "Objects: 1, Vase" in layout.texts
    assert "Left out: 2, Background (background), Teapot (hidden)" in layout.texts


def test_files_are_named_after_the_record_and_never_after_blenders_numbers(
    opened: Any, part: Part, tmp_path: Path
) -> None:
    vase = isolated()["vase"]
    vase.name = "1906.123"
    assert export(tmp_path / "numbers") == {"1906.123.glb"}
    vase.name = "Vase"
    # Another object of the file takes the name: Blender shows a number, the project does not.
    names, other = part("gaussian_heritage_addon.project.object_names"), bpy.data.objects.new("Other", None)
    vase.name = "Away"
    other.name = "Vase"
    names.give_name(vase, "Vase")
    vase.name = vase.heritage_state.shown_name = "Vase.001"
    assert export(tmp_path / "a") == {"Vase.glb"}
    vase.heritage.catalogue_number = "1906/12"
    assert export(tmp_path / "b") == {"1906_12 Vase.glb"}
    copy = vase.copy()
    copy.data = vase.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    assert export(tmp_path / "c") == {"1906_12 Vase.glb", "1906_12 Vase 2.glb"}
    text = (tmp_path / "c" / "1906_12 Vase.glb").read_bytes()
    assert b'"name":"Vase"' in text.replace(b'": "', b'":"') and b"Vase.001" not in text


def test_usd_is_written_by_the_engines_python(opened: Any, part: Part, tmp_path: Path) -> None:
    assert export(tmp_path / "out", format="USD") == {"Vase.usd"}
    python = part("gaussian_heritage_addon.setup.preferences").current_python()
    arguments = {"source": str(tmp_path / "out" / "Vase.usd"), "target": str(tmp_path / "back.ply")}
    part("engine.core.child_process").run_in_child(
        "formats.usd_reading:convert_usd", arguments, max_memory=1 << 32, max_seconds=60, what="reading", python=python
    )
    back = part("engine.formats").read_ply(tmp_path / "back.ply")
    shown = part("gaussian_heritage_addon.splats.splats").SplatScene.of(isolated()["vase"]).gaussians(0.5)
    np.testing.assert_allclose(back.means, shown.means, atol=1e-6)
    np.testing.assert_allclose(back.log_scales, shown.log_scales, atol=1e-5)


def test_usd_is_not_offered_where_nothing_can_write_it(opened: Any, installed: str, part: Part, tmp_path: Path) -> None:
    # Blender's own Python, as bpy of PyPI, has no OpenUSD.
    bpy.context.preferences.addons[installed].preferences.engine_python = sys.executable
    try:
        assert part("gaussian_heritage_addon.project.export").export_formats() == ("glb", "ply", "spz", "sog")
        with pytest.raises(TypeError, match='enum "USD" not found'):
            bpy.ops.heritage.export_objects(directory=str(tmp_path / "out"), format="USD")
        bpy.context.scene.heritage.show = "OBJECTS"
        isolated()["vase"].select_set(True)
        with pytest.raises(RuntimeError, match="neither Blender nor the engine has OpenUSD"):
            bpy.ops.heritage.export_splats(filepath=str(tmp_path / "all.usd"))
    finally:
        bpy.context.preferences.addons[installed].preferences.engine_python = ""


def test_several_objects_in_one_file_have_the_unit_of_all(room: Any, part: Part, tmp_path: Path) -> None:
    scene = part("engine.scene")
    distances = (scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0),)
    part("gaussian_heritage_addon.project.measuring").measure(bpy.context.scene, scene.Measurement(distances))
    isolated()["teapot"].heritage.hidden = False
    bpy.context.scene.heritage.show = "OBJECTS"
    for obj in bpy.context.scene.objects:
        obj.select_set(obj.heritage.object_id in ("vase", "teapot"))
    bpy.ops.heritage.export_splats(filepath=str(tmp_path / "all.ply"))
    assert b"comment unit metre" in (tmp_path / "all.ply").read_bytes()
