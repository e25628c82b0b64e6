"""Random Gaussians, a project folder and a fake engine, made with the code of the installed extension."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

Part = Callable[[str], ModuleType]
StandIn = Callable[[str], Path]
FOREVER = "import time\nwhile True: time.sleep(0.05)"
"""Source of a fake engine that does not end."""


@pytest.fixture
def part(blender: ModuleType, installed: str) -> Part:
    """Return a function that imports a module of the installed extension: ``part("engine.formats")``."""
    return lambda name: importlib.import_module(f"{installed}.{name}")


@pytest.fixture
def random_gaussians(part: Part) -> Callable[..., Any]:
    """Return a function ``random_gaussians(count, degree=3, seed=0)``."""
    gaussians_type = part("engine.scene.gaussians").Gaussians

    def make(count: int, *, degree: int = 3, seed: int = 0) -> Any:
        rng = np.random.default_rng(seed)

        def normal(*shape: int) -> np.ndarray:
            return rng.standard_normal(shape).astype(np.float32)

        bands = np.arange(1, (degree + 1) ** 2 + 1)[None, :, None] ** -0.5
        return gaussians_type(
            means=0.5 * normal(count, 3),
            log_scales=np.float32(np.log(0.08)) + 0.7 * normal(count, 3),
            quats=normal(count, 4),
            opacity_logits=2 * normal(count) + 1,
            sh=(0.5 * bands * normal(count, (degree + 1) ** 2, 3)).astype(np.float32),
        )

    return make


@pytest.fixture
def camera(part: Part) -> Any:
    """Return an oblique camera at (0.3, -3, 1) with uneven focal lengths and an off-centre principal point."""
    eye = np.array([0.3, -3.0, 1.0])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [right, np.cross(forward, right), forward]
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return part("engine.scene.camera").Camera("a b/view 1.jpg", 128, 96, "PINHOLE", (170.0, 160.0, 68.0, 44.0), viewmat)


@pytest.fixture
def project(part: Part, random_gaussians: Callable[..., Any], camera: Any, tmp_path: Path) -> Any:
    """Return a finished project with 100 Gaussians, one camera and the object ``vase`` of rows 0..39."""
    folder = tmp_path / "müseum room_heritage"
    part("engine.project.folder").ProjectFolder.create(folder)
    gaussians = random_gaussians(100, degree=1)
    part("engine.formats").write_ply(folder / "gaussians" / "scene.ply", gaussians)
    camera_set = part("engine.scene.camera").CameraSet(
        cameras=(camera,),
        unregistered=(),
        points=np.zeros((1, 3), np.float32),
        point_colors=np.zeros((1, 3), np.uint8),
        reprojection_error=0.5,
        original_from_world=np.eye(4),
        poses_given=False,
    )
    part("engine.scene.camera_storage").write_camera_set(folder / "cameras", camera_set)
    write_object(folder, "vase", "Vase", np.r_[np.linspace(0.2, 1, 40), np.zeros(60)].astype(np.float32))
    return SimpleNamespace(folder=folder, gaussians=gaussians)


@pytest.fixture
def opened(project: Any) -> Any:
    """Open the project of 100 Gaussians, and return it."""
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    return project


def german_texts(part: Part) -> dict[str, str]:
    """Return the German texts of the interface by the English ones."""
    (german,) = (one for one in part("engine.core.language").languages() if one.code == "de")
    return dict(german.texts)


def isolated() -> dict[str, bpy.types.Object]:
    """Return the objects of the opened project by id."""
    return {obj.heritage.object_id: obj for obj in bpy.data.objects if obj.heritage.role == "OBJECT"}


def write_object(project: Path, object_id: str, name: str, membership: np.ndarray, **known: Any) -> None:
    """Write an object as the engine does."""
    folder = project / "objects" / object_id
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "membership.npy", membership)
    record = {"version": 1, "id": object_id, "name": name, "prompt": {"text": name}, "score": 0.8, "threshold": 0.5}
    counts = {"n_gaussians": int((membership >= 0.5).sum()), "n_scene_gaussians": len(membership)}
    (folder / "object.json").write_text(json.dumps({**record, **counts, "fit": 0.9, "files": {}, **known}))


@pytest.fixture
def fake_engine(installed: str, tmp_path: Path) -> Iterator[StandIn]:
    """Yield a function that makes a fake engine, which runs the given source, and returns the file of its arguments."""

    def make(text: str) -> Path:
        arguments = tmp_path / "arguments.json"
        program = tmp_path / "engine python"
        writes = "write_object" in text
        program.write_text(
            f"#!{sys.executable}\nimport json, sys\nfrom pathlib import Path\n"
            # Importing NumPy takes longer than all else that most of these engines do.
            + ("import numpy as np\n" if writes or "np." in text else "")
            + f"Path({str(arguments)!r}).write_text(json.dumps(sys.argv[1:]))\n"
            "def say(kind, **fields): print(json.dumps({'v': 1, 'kind': kind, 'time': 0.0, **fields}), flush=True)\n"
            + (inspect.getsource(write_object).replace("**known: Any", "**known") if writes else "")
            + text,
            encoding="utf-8",
        )
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        if os.name == "nt":  # Windows starts no scripts of Python
            started = tmp_path / "engine python.bat"
            # Its folder, %~dp0, can have letters that no code page has, in which the text is read.
            started.write_text(f'@"{sys.executable}" "%~dp0{program.name}" %*\n', encoding="oem")
            program = started
        bpy.context.preferences.addons[installed].preferences.engine_python = str(program)
        return arguments

    yield make
    bpy.context.preferences.addons[installed].preferences.engine_python = ""


@pytest.fixture
def fake_command(installed: str, fake_engine: StandIn) -> Callable[[str], list[str]]:
    """Return a function that makes a fake engine, which runs the given source, and returns the command to start it."""

    def make(text: str) -> list[str]:
        fake_engine(text)
        return [bpy.context.preferences.addons[installed].preferences.engine_python]

    return make


def forget_jobs(runner: ModuleType) -> None:
    """Let the job runner forget all jobs; those that run are not ended."""
    runner._job, runner._waits_for_object_mode = None, False
    runner._queue.forget()
    for jobs in (runner._found, runner._undecided, runner._stopped):
        jobs.clear()


class FakeLayout:
    """Fake layout that checks calls against Blender's own description and records what is drawn.

    Attributes
    ----------
    texts : list of str
        Labels, and the texts of properties that have a text.
    props : list of str
        Names of the properties drawn.
    buttons : list of (str, dict)
        Operators, and the options their buttons set.
    icons : dict of str to str
        Icon of each operator.
    calls : list of str
        Names of what was drawn, in order; of labels with their text.
    """

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.props: list[str] = []
        self.calls: list[str] = []
        self.icons: dict[str, str] = {}
        self._buttons: list[tuple[str, SimpleNamespace]] = []

    @property
    def buttons(self) -> list[tuple[str, dict[str, Any]]]:
        return [(name, vars(options)) for name, options in self._buttons]

    def button(self, name: str) -> dict[str, Any]:
        """Return the options of the only button of an operator."""
        (options,) = [options for other, options in self.buttons if other == f"heritage.{name}"]
        return options

    def __getattr__(self, method: str) -> Callable[..., Any]:
        known = bpy.types.UILayout.bl_rna.functions[method].parameters

        def draw(*arguments: Any, **options: Any) -> Any:
            assert set(options) <= set(known.keys()), (method, options)
            icon = options.get("icon", "NONE")
            assert "icon" not in known or icon in known["icon"].enum_items, icon
            self.calls.append(f"label {options['text']}" if method == "label" else method)
            if "text" in options:
                self.texts.append(options["text"])
            if method == "prop":
                assert arguments[1] in arguments[0].bl_rna.properties, arguments[1]
                self.props.append(arguments[1])
            if method == "operator":
                self.icons[arguments[0]] = icon
                return self._operator(arguments[0])
            return self

        return draw

    def separator(self) -> None:
        """Do nothing: some versions of Blender have no description of this method."""

    def _operator(self, name: str) -> Any:
        properties = getattr(bpy.ops.heritage, name.partition(".")[2]).get_rna_type().properties
        button = SimpleNamespace()
        self._buttons.append((name, button))

        class Checked:
            def __setattr__(self, option: str, value: Any) -> None:
                assert option in properties, (name, option)
                setattr(button, option, value)

        return Checked()


Draw = Callable[[str], FakeLayout]


@pytest.fixture
def draw(part: Part) -> Draw:
    """Return a function that draws a panel by its name: ``draw("HERITAGE_PT_objects")``."""

    def make(name: str) -> FakeLayout:
        panel, drawn = getattr(bpy.types, name), FakeLayout()
        assert not hasattr(panel, "poll") or panel.poll(bpy.context)
        panel.draw(SimpleNamespace(layout=drawn), bpy.context)
        return drawn

    return make


@pytest.fixture
def runner(part: Part, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ModuleType]:
    """Yield the job runner as it works in a window, where jobs run while Blender is used; timers are called by hand."""
    runner = part("gaussian_heritage_addon.jobs.job_runner")
    forget_jobs(runner)
    jobs = tmp_path / "jobs"
    jobs.mkdir()
    monkeypatch.setattr(runner, "user_folder", lambda name: jobs)
    monkeypatch.setattr(runner, "show_job", lambda: None)
    monkeypatch.setattr(runner, "bpy", _InAWindow())
    yield runner
    for folder in jobs.iterdir():
        job = part("engine.workers.jobs").Job.attach(folder)
        if job is not None and job.poll().running:
            job.cancel(grace_seconds=0.0)
            job.wait()
    forget_jobs(runner)


class _InAWindow:
    """bpy that says it has a window."""

    class app:  # noqa: N801 as in bpy
        background = False

    def __getattr__(self, name: str) -> Any:
        return getattr(bpy, name)


def poll_to_the_end(runner: ModuleType) -> None:
    """Call the timer until it stops."""
    while runner._poll_job() is not None:
        if runner.current()[1].running:
            runner._job.wait()


def segment_in_engine(runner: ModuleType, project: Any, prompt: str) -> None:
    """Start a job that isolates what `prompt` names."""
    runner.start("segment", project.folder, "segment", str(project.folder), "--prompt", prompt)
