"""What is killed: 8 photos, a project as it stands before each stage, and what an uninterrupted run makes of it."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from PIL import Image

from engine.core.errors import Cancelled
from engine.core.events import Event, StageFinished
from engine.pipeline.reconstruct import reconstruct
from engine.scene import read_camera_set

from .kills_checks import objects_of, scene_of
from .kills_engine import PRESET, pipeline_settings
from .kills_process import ROOT, EngineRun

_VIEWS = range(4, 12)
"""Neighbouring photos of the museum room, which COLMAP places."""
_SIZE = (384, 288)
_PROMPTS = ("teapot", "hourglass")
"""Texts that are found in them; `_FURTHER`, too."""
_FURTHER = "jug"
_CLICK = "view_08.jpg=160,150"


def write_small_photos(folder: Path, views: Iterable[int]) -> None:
    """Write these photos of the museum room, reduced, into a new folder."""
    folder.mkdir(parents=True)
    for view in views:
        name = f"view_{view:02}.jpg"
        with Image.open(ROOT / "demo" / "museum_room" / "photos" / name) as photo:
            photo.resize(_SIZE, Image.Resampling.LANCZOS).save(folder / name, quality=95)


@dataclass(frozen=True)
class Kind:
    """One stage of ``reconstruct``, or one other command.

    Attributes
    ----------
    name : str
    state : str
        Name of the prepared project that the command starts from; empty: no project yet.
    command : str
        Arguments; ``{photos}``, ``{project}``, ``{model}`` and ``{out}`` are replaced.
    share : int
        Trials of 200.
    stage : str
        Stage to kill; empty: the whole command.
    reconstructs : bool
        Whether the command is ``reconstruct``, so that the whole scene is compared, and not only objects.
    may_repeat : bool
        Whether a repetition of the finished command would do the same to the same project.
    """

    name: str
    state: str
    command: str
    share: int
    stage: str = ""
    reconstructs: bool = True
    may_repeat: bool = True


_RECONSTRUCT = f"reconstruct {{photos}} --out {{project}} --preset {PRESET}"
_WITHOUT_OBJECTS = f"{_RECONSTRUCT} --no-objects"
_WITH_PROMPTS = f"{_RECONSTRUCT} --prompts {';'.join(_PROMPTS)}"


def _segment(name: str, arguments: str, share: int, *, may_repeat: bool = True) -> Kind:
    return Kind(name, "finished", f"segment {{project}} {arguments}", share, reconstructs=False, may_repeat=may_repeat)


def _export(file_format: str) -> Kind:
    # A record says when it was exported.
    arguments = f"--format {file_format.lower()} --record none --out {{out}}.{file_format.lower()} --overwrite"
    return Kind(f"export, {file_format}", "finished", f"export {{project}} {arguments}", 10, reconstructs=False)


KINDS = (
    Kind("photos", "", _WITHOUT_OBJECTS, 14, "photos"),
    Kind("cameras", "cameras", _WITHOUT_OBJECTS, 28, "cameras"),
    Kind("cameras, COLMAP model given", "", f"{_WITHOUT_OBJECTS} --cameras {{model}}", 8, "cameras"),
    Kind("masks", "masks", _RECONSTRUCT, 22, "masks"),
    Kind("training", "training", _RECONSTRUCT, 34, "training"),
    Kind("objects, first text", "objects", _WITH_PROMPTS, 8, "objects"),
    Kind("objects, photos described", "objects-described", _WITH_PROMPTS, 14, "objects"),
    Kind("report", "report", _WITH_PROMPTS, 16, "report"),
    _segment("segment --click", f"--click {_CLICK} --name thing", 14),
    _segment("segment --prompt", f"--prompt {_FURTHER}", 8),
    _segment("segment --refine", f"--refine {_PROMPTS[1]} --click {_CLICK}", 8, may_repeat=False),
    _segment("segment --complement", "--complement", 6),
    _export("PLY"),
    _export("GLB"),
)


@dataclass
class Reference:
    """What an uninterrupted run made of a state, and how long its stage took.

    Attributes
    ----------
    project : Path
    seconds : float
        From the beginning of the stage to that of the next, or to the end of the command.
    scene, objects : dict of str to str
        As `kills_checks` returns them.
    exported : bytes
        The exported file; empty for other commands.
    """

    project: Path
    seconds: float
    scene: dict[str, str]
    objects: dict[str, str]
    exported: bytes


@dataclass
class Fixture:
    """The prepared photos, projects and references in a folder.

    Attributes
    ----------
    folder : Path
    references : dict of str to Reference
        By the name of the kind.
    """

    folder: Path
    references: dict[str, Reference] = field(default_factory=dict)

    @property
    def photos(self) -> Path:
        """The folder of the photos."""
        return self.folder / "photos"

    @property
    def calibration(self) -> Path:
        """A calibration of the forecasts, so that no run measures this machine again."""
        return self.folder / "calibration.json"

    def state(self, kind: Kind) -> Path:
        """Return the project that a kind starts from."""
        return self.folder / "states" / kind.state

    def arguments(self, kind: Kind, folder: Path) -> list[str]:
        """Return the command line of a kind for the project ``folder/project``."""
        places = {
            "photos": self.photos,
            "project": folder / "project",
            "model": self.folder / "model",
            "out": folder / "exported",
        }
        # Split before the paths are filled in, which may contain spaces.
        return [part.format(**places) for part in kind.command.split()]

    def start(self, kind: Kind, folder: Path) -> EngineRun:
        """Copy the state of a kind to ``folder/project``, unless it is there, and start the command of the kind."""
        folder.mkdir(parents=True, exist_ok=True)
        calibration = folder / "calibration.json"
        if not calibration.exists():
            if kind.state:
                shutil.copytree(self.state(kind), folder / "project")
            shutil.copy(self.calibration, calibration)
        return EngineRun.start(self.arguments(kind, folder), folder, calibration=calibration)

    def make_states(self) -> None:
        """Make the photos and the projects as they stand before each stage. `shorten_stages` was called before."""
        write_small_photos(self.photos, _VIEWS)
        self._run_until("cameras", wants_objects=False)
        shutil.rmtree(self._work)
        for stage in ("masks", "training"):
            self._run_until(stage)
        self._run_until("")
        for stage in ("objects", "report"):
            self._run_until(stage, prompts=_PROMPTS)
        self._run_until("", prompts=_PROMPTS)
        require_objects(self._work, _PROMPTS)
        described = self.folder / "states" / "objects-described"
        shutil.copytree(self.folder / "states" / "objects", described)
        for cache in ("groups", "masks"):
            shutil.copytree(self._work / cache, described / cache, dirs_exist_ok=True)
        shutil.copytree(self._work, self.folder / "states" / "finished")
        _write_colmap_model(self._work / "cameras", self.folder / "model")

    @property
    def _work(self) -> Path:
        return self.folder / "work"

    def _run_until(self, stage: str, *, wants_objects: bool = True, prompts: tuple[str, ...] = ()) -> None:
        """Run to the beginning of `stage` and keep a copy; empty: to the end."""
        finished: list[str] = []
        stages = ("photos", "cameras", "masks", "training", "objects", "report")
        before = stages[stages.index(stage) - 1] if stage else None

        def emit(event: Event) -> None:
            if isinstance(event, StageFinished):
                finished.append(event.stage)

        settings = pipeline_settings(wants_objects=wants_objects, prompts=prompts)
        try:
            reconstruct(self.photos, self._work, settings, emit=emit, should_stop=lambda: before in finished)
        except Cancelled:
            shutil.copytree(self._work, self.folder / "states" / stage)

    def make_reference(self, kind: Kind) -> None:
        """Run a kind without a kill."""
        folder = self.folder / "references" / kind.name.replace(" ", "-")
        run = self.start(kind, folder)
        began = run.wait_until_begun(kind.stage)
        seconds = run.seconds_of(kind.stage)
        if not began or run.process.returncode != 0:
            raise RuntimeError(f"{kind.name} fails without a kill: {run.events[-1:]} {run.errors.read_text()}")
        project = folder / "project"
        exported = next((file.read_bytes() for file in folder.glob("exported.*")), b"")
        scene = scene_of(project) if kind.reconstructs else {}
        self.references[kind.name] = Reference(project, seconds, scene, objects_of(project), exported)


def require_objects(project: Path, texts: Sequence[str]) -> None:
    """Raise RuntimeError unless each text has found an object: without objects, no kill could lose one."""
    stored = objects_of(project)
    if missing := [text for text in texts if text not in stored]:
        raise RuntimeError(
            f"The photos of the kills show no {', no '.join(missing)}. Choose other texts in {__name__}."
        )


def _write_colmap_model(cameras: Path, folder: Path) -> None:
    """Write the cameras of a project as a COLMAP model in text, to be given to ``--cameras``."""
    folder.mkdir()
    camera_set, model = read_camera_set(cameras), pycolmap.Reconstruction()
    for number, camera in enumerate(camera_set.cameras, start=1):
        lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
        lens.camera_id = number
        model.add_camera_with_trivial_rig(lens)
        rotation = pycolmap.Rotation3d(np.ascontiguousarray(camera.viewmat[:3, :3]))
        image = pycolmap.Image(name=camera.photo, camera_id=number, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, camera.viewmat[:3, 3]))
    for point in camera_set.points:
        model.add_point3D(point, pycolmap.Track(), np.full(3, 128, np.uint8))
    model.write_text(folder)
