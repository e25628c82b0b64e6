"""Files are dropped, two Blenders know of each other, and a text prompt knows the view."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part


def open_project(project: Any) -> bpy.types.Object:
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def test_second_blender_on_a_project_is_told_until_the_first_is_closed(
    project: Any, part: Part, draw: Callable[[str], Any]
) -> None:
    module = part("gaussian_heritage_addon.project.open_projects")
    mark, hold = module.mark_of(project.folder), part("engine.project.folder").hold_mark
    # Another process holds the mark, as another Blender does.
    hold(mark).close()
    extension = Path(part("engine").__file__).parents[1]
    code = (
        f"import sys; sys.path.insert(0, {str(extension)!r}); from engine.core.system import try_lock; "
        f"f = open({str(mark)!r}, 'a+'); print('held' if try_lock(f) else 'not held', flush=True); sys.stdin.read()"
    )
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        open_project(project)
        assert any("Another Blender has this project open" in text for text in texts(draw))
    finally:
        other.communicate("")
    module.update()
    assert not any("Another Blender" in text for text in texts(draw))
    # Now this Blender holds it.
    assert hold(mark) is None
    bpy.context.scene.heritage.project = ""
    module.update()
    claim = hold(mark)
    assert claim is not None
    claim.close()
    assert not [path for path in project.folder.rglob("*lock")]


def texts(draw: Callable[[str], Any]) -> list[str]:
    return [" ".join(draw("HERITAGE_PT_scene").texts)]


@pytest.mark.parametrize(
    ("handler", "suffixes", "options"),
    [
        ("HERITAGE_FH_gaussian_ply", {".ply", ".spz", ".sog", ".splat", ".ksplat"}, {"filepath"}),
        ("HERITAGE_FH_photos", {".jpg", ".png", ".heic"}, {"directory", "files"}),
        ("HERITAGE_FH_video", {".mp4", ".mov"}, {"filepath"}),
    ],
)
def test_dropped_files_are_given_to_an_operator_that_takes_them(
    handler: str, suffixes: set[str], options: set[str]
) -> None:
    cls = getattr(bpy.types, handler)
    assert suffixes <= set(cls.bl_file_extensions.split(";"))
    operator = getattr(bpy.ops.heritage, cls.bl_import_operator.partition(".")[2])
    properties = operator.get_rna_type().properties
    assert options <= set(properties.keys())


def test_dropped_photos_import_their_folder(fake_engine: Callable[[str], Path], tmp_path: Path) -> None:
    folder = tmp_path / "Fotos Böhmen"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(b"")
    arguments = fake_engine("say('error', message='enough', error='PhotoError'); sys.exit(1)")
    with pytest.raises(RuntimeError, match="enough"):
        bpy.ops.heritage.import_photo_folder(directory=str(folder), files=[{"name": "a.jpg"}], preset="preview")
    assert str(folder) in eval(arguments.read_text(encoding="utf-8"))


def test_shortcuts_name_operators_and_options_that_exist(part: Part) -> None:
    shortcuts = part("operators.shortcuts").SHORTCUTS
    assert len({key for key, _, _ in shortcuts}) == len(shortcuts)
    for _, name, options in shortcuts:
        properties = getattr(bpy.ops.heritage, name.partition(".")[2]).get_rna_type().properties
        for option, value in options.items():
            assert value in properties[option].enum_items, (name, option)


def test_text_prompt_knows_where_the_user_looks_from_also_in_a_measured_scene(project: Any, part: Part) -> None:
    module, scene = part("gaussian_heritage_addon.project.visible_splats"), part("engine.scene")
    whole = open_project(project)
    for metres in (None, 5.0):
        if metres is not None:
            distance = scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), metres)
            ground = ((0.0, 0.0, 0.1), (1.0, 0.0, 0.2), (0.0, 1.0, 0.3))
            scene.save_measurement(project.folder, scene.Measurement((distance,), ground=ground))
            whole = open_project(project)
        bpy.context.view_layer.update()
        # A view of the scene from (0, -3, 0) along Y, with X to the right, wherever the scene stands.
        camera = np.eye(4)
        camera[:3, :3], camera[:3, 3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], (0, -3, 0)
        world = np.array(whole.matrix_world, np.float64) @ camera
        world[:3, :3] /= np.cbrt(np.linalg.det(world[:3, :3]))
        lens = np.diag([1.5, 2.0, -1.0, 0.0])
        view = SimpleNamespace(view_matrix=np.linalg.inv(world).astype(np.float32), window_matrix=lens)
        area = SimpleNamespace(
            type="VIEW_3D",
            regions=[SimpleNamespace(type="WINDOW", width=800, height=600)],
            spaces=SimpleNamespace(active=SimpleNamespace(region_3d=view)),
        )
        found = module.viewport_camera(SimpleNamespace(area=area, scene=bpy.context.scene))
        np.testing.assert_allclose(found.center, (0, -3, 0), atol=1e-4)
        np.testing.assert_allclose(found.viewmat[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-5)
        (argument,) = [
            one
            for one in part("engine.workers.jobs").text_arguments("left vase", camera=found)
            if one.startswith("--seen")
        ]
        assert argument.startswith('--seen-from={"width": 800')
    assert module.viewport_camera(bpy.context) is None


def test_place_of_project_and_report_is_said_also_where_no_program_shows_them(
    project: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    report = project.folder / "report" / "report.html"
    report.parent.mkdir()
    report.touch()
    # Blender's own operators, which would start programs.
    monkeypatch.setattr(bpy.ops, "wm", SimpleNamespace(path_open=lambda filepath: None, url_open=lambda url: None))
    said: list[str] = []
    operator = SimpleNamespace(report=lambda kind, sentence: said.append(sentence))
    for name, place in (("show_folder", project.folder), ("open_report", report)):
        getattr(bpy.types, f"HERITAGE_OT_{name}").execute(operator, bpy.context)
        assert str(place) in said[-1]
