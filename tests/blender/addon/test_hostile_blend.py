"""A .blend file from someone else runs nothing and writes nothing, and ends every action in one sentence.

What the file stores of ours may be anything: paths, ids, numbers of Gaussians, attributes, node groups, cameras.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import FakeLayout, Part, write_object

Change = Callable[[], object]
PANELS = ("HERITAGE_PT_scene", "HERITAGE_PT_objects", "HERITAGE_PT_progress", "HERITAGE_PT_training")
DISPLAY = "Gaussian Splats"


def vase() -> bpy.types.Object:
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "OBJECT")


def whole() -> bpy.types.Object:
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def a_camera() -> bpy.types.Object:
    return next(obj for obj in bpy.data.objects if obj.type == "CAMERA")


def stored(path: str, **values: Any) -> None:
    """Set properties as a file may contain them: without the functions that Blender calls on a change."""
    owner = bpy.context.scene if path == "scene" else vase()
    if path == "object":
        owner.heritage.is_loading = True
    for name, value in values.items():
        setattr(owner.heritage, name, value)
    if path == "object":
        owner.heritage.is_loading = False


def replace_attribute(obj: bpy.types.Object, name: str, data_type: str | None, domain: str = "POINT") -> None:
    """Remove an attribute; add one of the same name with another type."""
    obj.data.attributes.remove(obj.data.attributes[name])
    if data_type is not None:
        obj.data.attributes.new(name, data_type, domain)


def fill(obj: bpy.types.Object, name: str, value: int) -> None:
    values = np.full(len(obj.data.vertices), value, np.int32)
    obj.data.attributes[name].data.foreach_set("value", values)


def replace_group(kind: str) -> None:
    """Replace the node group of the display by another of the same name."""
    for obj in (vase(), whole()):
        obj.modifiers[DISPLAY].node_group = None
    for tree in list(bpy.data.node_groups):
        name = tree.name
        bpy.data.node_groups.remove(tree)
        bpy.data.node_groups.new(name, kind)


def replace_modifier(obj: bpy.types.Object) -> None:
    obj.modifiers.remove(obj.modifiers[DISPLAY])
    obj.modifiers.new(DISPLAY, "SUBSURF")


def wrong_inputs() -> None:
    """Give the inputs of the display another type."""
    tree = vase().modifiers[DISPLAY].node_group
    for item in list(tree.interface.items_tree):
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name != "Geometry":
            name = item.name
            tree.interface.remove(item)
            tree.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketString")


def empty_mesh(obj: bpy.types.Object) -> None:
    obj.data.clear_geometry()


def delete_collections() -> None:
    for collection in list(bpy.data.collections):
        bpy.data.collections.remove(collection)


def to_empty(obj: bpy.types.Object) -> None:
    """Replace a splat object by an empty with the same properties."""
    empty = bpy.data.objects.new("empty", None)
    bpy.context.scene.collection.objects.link(empty)
    for name in ("role", "project", "object_id"):
        setattr(empty.heritage, name, getattr(obj.heritage, name))
    bpy.data.objects.remove(obj)


def key(obj: bpy.types.Object, name: str, value: Any) -> None:
    if value is None:
        del obj[name]
    else:
        obj[name] = value


CHANGES: dict[str, Change] = {
    "nothing": lambda: None,
    "project is empty": lambda: stored("scene", project=""),
    "project is a relative path": lambda: stored("scene", project="../../x"),
    "project looks like an option": lambda: stored("scene", project="--help"),
    "project is a device": lambda: stored("scene", project="/dev/null"),
    "project is too long": lambda: stored("scene", project="/" + "x" * 5000),
    "project has a line break": lambda: stored("scene", project="/tmp/a\nb\x1b[31m"),
    "object of another project": lambda: stored("object", project="/nowhere"),
    "object without a project": lambda: stored("object", project=""),
    "object id leads out": lambda: stored("object", object_id="../../theirs"),
    "object id is absolute": lambda: stored("object", object_id="/theirs"),
    "object id is empty": lambda: stored("object", object_id=""),
    "object id looks like an option": lambda: stored("object", object_id="--complement"),
    "object id is too long": lambda: stored("object", object_id="x" * 5000),
    "very many levels": lambda: stored("object", n_levels=2**31 - 1, level=2**31 - 1),
    "level beyond the last": lambda: stored("object", n_levels=2, level=5),
    "another kind": lambda: stored("object", kind="\x1b" * 1000),
    "whole scene twice": lambda: stored("object", role="SCENE"),
    "active object is a camera": lambda: stored("scene", active=bpy.data.objects.find(a_camera().name)),
    "active object beyond the last": lambda: stored("scene", active=2**31 - 1),
    **{
        f"{name} has the count {value!r}": lambda name=name, value=value: key(
            whole() if name == "scene" else vase(), "heritage_count", value
        )
        for name in ("scene", "object")
        for value in (None, "many", -1, 2**31 - 1, 1.5, [1, 2], 0)
    },
    **{
        f"{name} of type {kind}": lambda name=name, kind=kind: replace_attribute(whole(), name, kind)
        for name in ("rotation", "scale", "radiance:base", "radiance:sh_1", "gaussian_index")
        for kind in (None, "BOOLEAN", "FLOAT")
    },
    "membership missing": lambda: replace_attribute(vase(), "membership", None),
    "membership of another type": lambda: replace_attribute(vase(), "membership", "INT"),
    "membership of another domain": lambda: replace_attribute(vase(), "membership", "FLOAT", "CORNER"),
    "rows beyond the scene": lambda: fill(whole(), "gaussian_index", 2**30),
    "rows below -1": lambda: fill(whole(), "gaussian_index", -(2**30)),
    "no Gaussians in the scene": lambda: empty_mesh(whole()),
    "no Gaussians in the object": lambda: empty_mesh(vase()),
    "object is an empty": lambda: to_empty(vase()),
    "scene is an empty": lambda: to_empty(whole()),
    "scene flattened": lambda: setattr(whole(), "scale", (0, 0, 0)),
    "object flattened": lambda: setattr(vase(), "scale", (0, 1, 1)),
    "object at infinity": lambda: setattr(vase(), "location", (float("inf"),) * 3),
    "display removed": lambda: vase().modifiers.clear(),
    "display is another modifier": lambda: replace_modifier(vase()),
    "display has no inputs": lambda: replace_group("GeometryNodeTree"),
    "display is a shader": lambda: replace_group("ShaderNodeTree"),
    "display has other inputs": wrong_inputs,
    "collections deleted": delete_collections,
    "no camera": lambda: bpy.data.objects.remove(a_camera()),
    "scene camera is no camera": lambda: setattr(bpy.context.scene, "camera", vase()),
    "photo is a number": lambda: key(a_camera(), "heritage_photo", 5),
    "photo leads out": lambda: key(a_camera(), "heritage_photo", "../../x.jpg"),
    "photo looks like an option": lambda: key(a_camera(), "heritage_photo", "--all"),
    "photo of a mesh": lambda: key(vase(), "heritage_photo", "x.jpg"),
    **{
        f"photo of size {value!r}": lambda value=value: key(a_camera(), "heritage_size", value)
        for value in (None, 5, "large", [0, 0], [-1, 5], [2**31 - 1] * 2, [1.5, float("nan")], [1, 2, 3])
    },
    **{
        f"photo of aspect {value!r}": lambda value=value: key(a_camera(), "heritage_pixel_aspect", value)
        for value in (None, "x", 0.0, -1.0, float("nan"), 1e300)
    },
    "camera at infinity": lambda: setattr(a_camera(), "location", (float("nan"),) * 3),
}


def tree(folder: Path) -> dict[str, str]:
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in folder.rglob("*")
        if "museum.blend" not in path.name
    }


_WATCHED: list[tuple[str, str]] | None = None


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if _WATCHED is None:
        return
    if event in ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.remove", "os.rename"):
        _WATCHED.append((event, str(arguments[:1])))
    elif event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
        _WATCHED.append((event, str(arguments[0])))


@pytest.fixture
def watched() -> Iterator[list[tuple[str, str]]]:
    """Yield a list to which programs that are started and files that are written by Python are added."""
    global _WATCHED
    if not hasattr(sys, "_heritage_hook"):
        sys.addaudithook(_note)  # cannot be removed
        sys._heritage_hook = True  # type: ignore[attr-defined]
    _WATCHED = []
    yield _WATCHED
    _WATCHED = None


@pytest.fixture
def log(part: Part) -> Path:
    """Return the log of unexpected errors, which a test expects not to be written."""
    file: Path = part("gaussian_heritage_addon.setup.preferences").user_folder("log") / "errors.log"
    file.unlink(missing_ok=True)
    part("gaussian_heritage_addon.blender.problems")._logged.clear()
    part("gaussian_heritage_addon.jobs.job_runner")._job = None
    return file


@pytest.fixture
def finished_jobs(part: Part, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[list[str]]]:
    """Replace each job by one that has found the vase, without starting a process; yield the commands."""
    runner, commands = part("gaussian_heritage_addon.jobs.job_runner"), list[list[str]]()
    state = part("engine.workers.jobs").JobState(
        running=False, finished=True, message="Done.", outputs={"objects": ["vase"]}
    )

    def start(command: list[str], folder: Path, *, kind: str, subject: str, environment: Any) -> Any:
        commands.append(command)
        return SimpleNamespace(
            kind=kind, subject=subject, command=command, of_earlier_session=False, wait=lambda: state,
            poll=lambda: state, mark_taken=lambda: None, is_taken=lambda: False,
        )  # fmt: skip

    monkeypatch.setattr(runner.Job, "start", start)
    monkeypatch.setattr(runner, "current_python", lambda: Path(sys.executable))
    yield commands
    runner._job = None


@pytest.fixture
def museum(project: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a folder with a project and, after ``save(change)``, the file ``museum.blend`` that shows it, changed.

    The unchanged file is made only once, since building the display takes most of the time of a test.
    """
    base = tmp_path_factory.getbasetemp() / "museum"
    folder = base / "folder"
    if not base.exists():
        levels = np.zeros((2, 100), np.float32)
        levels[0, :10], levels[1, :40] = 0.9, 0.9
        counts = [{"n_gaussians": 10}, {"n_gaussians": 40}]
        write_object(project.folder, "vase", "Vase", levels[1], level=1, levels=counts)
        np.save(project.folder / "objects" / "vase" / "levels.npy", levels)
        shutil.copytree(project.folder, folder / "room_heritage")
        assert bpy.ops.heritage.open_project(directory=str(folder / "room_heritage")) == {"FINISHED"}
        bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
        bpy.ops.wm.save_as_mainfile(filepath=str(base / "unchanged.blend"))
        for name in ("exported", "theirs"):
            (folder / name).mkdir()
        shutil.copytree(folder, base / "unchanged")
    shutil.rmtree(folder)
    shutil.copytree(base / "unchanged", folder)
    file = folder / "museum.blend"

    def save(change: Change) -> None:
        bpy.ops.wm.open_mainfile(filepath=str(base / "unchanged.blend"))
        change()
        bpy.ops.wm.save_as_mainfile(filepath=str(file))
        bpy.ops.wm.read_homefile(use_empty=True)

    return SimpleNamespace(
        folder=folder,
        project=folder / "room_heritage",
        save=save,
        open=lambda: bpy.ops.wm.open_mainfile(filepath=str(file)),
    )


def draw_panels() -> None:
    """Draw every panel that is shown."""
    for name in PANELS:
        panel = getattr(bpy.types, name)
        if not hasattr(panel, "poll") or panel.poll(bpy.context):
            panel.draw(SimpleNamespace(layout=FakeLayout()), bpy.context)
    for obj in bpy.data.objects:
        bpy.types.HERITAGE_UL_objects.draw_item(
            SimpleNamespace(), bpy.context, FakeLayout(), None, obj, 0, None, "", 0, 0
        )


CORNER = {"name": "", "photo": "a b/view 1.jpg", "x": 70.0, "y": 50.0, "wanted": True}


def use_everything(part: Part, folder: Path) -> list[str]:
    """Press every button, move every slider, draw every panel; return what the operators report."""
    ops, reports = bpy.ops.heritage, []
    calls: list[Callable[[], object]] = [
        lambda: ops.look_through_photo(step=1),
        lambda: ops.isolate(prompt="bust"),
        lambda: ops.isolate(photo="a b/view 1.jpg", x=1.0, y=2.0),
        lambda: ops.refine_object(level=0),
        lambda: ops.find_objects(),
        lambda: ops.isolate_background(),
        lambda: ops.accept_candidate(number=1),
        lambda: ops.dismiss_candidates(),
        lambda: ops.export_objects(directory=str(folder / "exported"), scope="ALL", format="PLY"),
        lambda: ops.export_objects(directory=str(folder / "exported"), scope="SCENE", format="GLB"),
        lambda: _click(part),
        lambda: ops.pick_object(photo="a b/view 1.jpg", x=64.0, y=48.0),
        lambda: ops.floaters(remove=True),
        lambda: ops.edit_region(action="ADD", path=[CORNER, {**CORNER, "x": 1.0, "y": 1.0}]),
    ]
    errors = part("engine.core.errors")
    for call in calls:
        try:
            call()
        except RuntimeError as error:
            reports.append(str(error).strip())
        except errors.HeritageError as error:
            reports.append(part("gaussian_heritage_addon.blender.problems").sentence_of(error))
    for obj in list(bpy.data.objects):
        if obj.heritage.role != "NONE":
            obj.heritage.threshold = 0.25
            obj.heritage.level = 0
            obj.heritage.part_to_whole = 1.0
            obj.heritage.title = "A title"
    scene = bpy.context.scene.heritage
    scene.show, scene.blending, scene.photo_opacity = "OBJECTS", "LINEAR", 0.5
    draw_panels()
    return reports


def _click(part: Part) -> None:
    """Click in a viewport."""
    region = SimpleNamespace(x=0, y=0, width=100, height=100, type="WINDOW")
    view = SimpleNamespace(view_perspective="PERSP", perspective_matrix=np.eye(4))
    spaces = SimpleNamespace(active=SimpleNamespace(region_3d=view))
    area = SimpleNamespace(type="VIEW_3D", regions=[region], spaces=spaces, tag_redraw=lambda: None)
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(bpy.context.scene, area)
    viewport.show_photo(0)
    viewport.click(50, 50, True)


# A sixth of all time; what is stored is checked by our own code, and public runners try it in each Blender.
@pytest.mark.once
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_file_from_someone_else_ends_every_action_in_a_sentence(
    museum: Any,
    part: Part,
    log: Path,
    finished_jobs: list[list[str]],
    watched: list[tuple[str, str]],
    change: Change,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The 576 rays of a region would take a third of the time; 25 hit the same.
    monkeypatch.setattr(part("gaussian_heritage_addon.splats.region_selection"), "_GRID", 5)
    museum.save(change)
    before = tree(museum.folder)
    watched.clear()
    museum.open()
    draw_panels()
    # Opening and looking runs and writes nothing.
    assert (finished_jobs, watched, tree(museum.folder)) == ([], [], before)
    reports = use_everything(part, museum.folder)
    unexpected = log.read_text(encoding="utf-8") if log.exists() else ""
    assert unexpected == ""
    for command in finished_jobs:
        assert command[1:4] == ["-m", "engine", "segment"] and Path(command[4]).is_absolute()
        assert not [word for word in command[5:] if not word.startswith("--")]
    for report in reports:
        assert report.endswith(".") and "\n" not in report and len(report) < 7000, report
    assert "Traceback" not in "".join(capfd.readouterr())
    allowed = ("exported", str(museum.project / "objects" / "vase" / "record.json"))
    after = tree(museum.folder)
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    assert not [name for name in changed if not any(part_of in name for part_of in allowed)]


def test_watch_sees_programs_and_files(watched: list[tuple[str, str]], tmp_path: Path) -> None:
    """Otherwise the test above could not fail."""
    import subprocess

    (tmp_path / "x").write_text("x")
    subprocess.run([sys.executable, "-c", ""], check=True)
    assert {event for event, _ in watched} >= {"open", "subprocess.Popen"}


def test_file_cannot_choose_the_program_that_is_run(museum: Any, installed: str) -> None:
    """The interpreter is a preference of the user, which a .blend file does not contain."""
    preferences = bpy.context.preferences.addons[installed].preferences
    preferences.engine_python = "/usr/bin/mine"

    def change() -> None:
        for owner in (bpy.context.scene, bpy.context.scene.heritage, vase().heritage):
            owner["engine_python"] = owner["python"] = "/usr/bin/theirs"

    try:
        museum.save(change)
        museum.open()
        assert preferences.engine_python == "/usr/bin/mine"
    finally:
        preferences.engine_python = ""
    names = set(bpy.types.Scene.bl_rna.properties["heritage"].fixed_type.properties.keys())
    names |= set(bpy.types.Object.bl_rna.properties["heritage"].fixed_type.properties.keys())
    assert not [name for name in names if "python" in name or "command" in name or "model" in name]


def test_title_is_not_written_to_a_folder_that_is_no_project(museum: Any) -> None:
    theirs = museum.folder / "theirs"
    museum.save(lambda: stored("object", project=str(theirs), object_id="vase"))
    museum.open()
    vase().heritage.title = "A title"
    assert list(theirs.rglob("*")) == []
    assert "Changes are kept in this .blend file only" in vase().heritage.problem
    assert vase().heritage.title == "A title"
