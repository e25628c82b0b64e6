"""What a killed run may leave: readable files, nothing lost; and whether two projects hold the same scene."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from engine.core.errors import HeritageError
from engine.core.files import parse_json, read_bytes
from engine.formats import read_ply
from engine.masks import read_label_map
from engine.pipeline.stages import STAGES
from engine.project.folder import PROJECT_FILE, ProjectFolder
from engine.project.objects import list_objects, load_membership, load_record
from engine.scene import load_detailed, read_camera_set
from engine.training import load_gaussians

_MAX_BYTES = 1 << 30
_ADVICE = "It was damaged by a kill."


def damaged_files(project: Path) -> list[str]:
    """Return what of a project cannot be read, each as a sentence; files under a temporary name do not count.

    Every file must be whole, as the kill left it and after the engine has opened the project, which must then open
    with every stage that it calls done.
    """
    problems = _unreadable(project)
    try:
        with opened_copy(project) as copy:
            if copy is not None:
                problems += [problem for problem in _unreadable(copy) if problem not in problems]
                _open_everything(copy)
    except (HeritageError, OSError, ValueError) as error:
        problems.append(f"the project: {type(error).__name__}: {error}")
    return problems


def _unreadable(project: Path) -> list[str]:
    problems = []
    for file in _files(project):
        name, check = file.relative_to(project), _READERS.get(file.suffix)
        # Names with a dot are temporary; an empty file in a set that replaces others stands for one to be deleted.
        if check is None or any(part.startswith(".") for part in name.parts):
            continue
        try:
            check(file)
        except Exception as error:  # noqa: BLE001 whatever a reader says is the finding
            problems.append(f"{name}: {type(error).__name__}: {error}")
    return problems


@contextlib.contextmanager
def opened_copy(project: Path) -> Iterator[Path | None]:
    """Yield a copy of a project after the engine has opened it for writing; None when there is no project yet.

    The engine then finishes what a killed run had begun to replace. A copy, because the continuation must find the
    project as the kill left it.
    """
    if not (project / PROJECT_FILE).is_file():
        yield None
        return
    with tempfile.TemporaryDirectory(dir=project.parent) as folder:
        copy = Path(folder, project.name)
        shutil.copytree(project, copy, symlinks=True)
        with ProjectFolder.open_existing(copy):
            yield copy


def _files(project: Path) -> list[Path]:
    return sorted(Path(folder, name) for folder, _, names in os.walk(project) for name in names)


def _check_json(file: Path) -> None:
    text = read_bytes(file, max_bytes=_MAX_BYTES, advice=_ADVICE).decode("utf-8")
    parse_json(text, object, source=str(file), advice=_ADVICE)


def _check_arrays(file: Path) -> None:
    # Opened here because np.load leaves a file open that is not a zip archive.
    with file.open("rb") as stream:
        loaded = np.load(stream, allow_pickle=False)
        if file.suffix == ".npz":
            for name in loaded.files:
                loaded[name]


def _check_picture(file: Path) -> None:
    with Image.open(file) as picture:
        picture.load()


def _check_database(file: Path) -> None:
    # Writable, because a database whose writer was killed is repaired from its journal when it is opened.
    connection = sqlite3.connect(file)
    try:
        (answer,) = connection.execute("PRAGMA integrity_check").fetchone()
    finally:
        connection.close()
    if answer != "ok":
        raise ValueError(answer)


_READERS: dict[str, Callable[[Path], Any]] = {
    ".json": _check_json,
    ".npy": _check_arrays,
    ".npz": _check_arrays,
    ".png": _check_picture,
    ".jpg": _check_picture,
    ".ply": read_ply,
    ".db": _check_database,
}


def _open_everything(project: Path) -> None:
    opened = ProjectFolder.open_existing(project)
    done = {stage for stage in STAGES if opened.stage_record(stage)}
    if "cameras" in done:
        read_camera_set(project / "cameras")
    for label_map in sorted((project / "masks").glob("*.npz")):
        if not label_map.name.endswith(".sam.npz"):
            read_label_map(label_map)
    if "training" in done:
        load_gaussians(project / "gaussians")
    objects_of(project)


def objects_of(project: Path) -> dict[str, str]:
    """Return a hash of each object by its id: memberships, levels, detailed Gaussians, score and museum record."""
    if not (project / "objects").is_dir():
        return {}
    found = {}
    for record in list_objects(project):
        detailed = load_detailed(project, record.id)
        levels = project / "objects" / record.id / "levels.npy"
        found[record.id] = _hash(
            load_membership(project, record.id),
            np.load(levels) if levels.is_file() else [],
            [] if detailed is None else [value for _, value in sorted(vars(detailed).items())],
            [record.score, record.fit, record.threshold, record.level, record.n_gaussians],
            load_record(project, record.id).as_dict(),
        )
    return found


def _hash(*parts: Any) -> str:
    digest = hashlib.sha256()

    def add(part: Any) -> None:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        elif isinstance(part, list | tuple):
            for item in part:
                add(item)
        elif hasattr(part, "__dataclass_fields__"):
            add([value for _, value in sorted(vars(part).items())])
        else:
            digest.update(json.dumps(part, sort_keys=True).encode())

    add(parts)
    return digest.hexdigest()


def scene_of(project: Path) -> dict[str, str]:
    """Return a hash of each part of a finished scene that must be the same after a kill; no times, no log."""
    opened = ProjectFolder.open_existing(project)
    cameras = read_camera_set(project / "cameras")
    maps = [file for file in sorted((project / "masks").glob("*.npz")) if not file.name.endswith(".sam.npz")]
    gaussians = project / "gaussians"
    parts: dict[str, Any] = {
        "stages": [stage for stage in STAGES if opened.stage_record(stage)],
        "photos": json.loads((project / "photos" / "photos.json").read_text(encoding="utf-8"))["photos"],
        "poses": [
            [camera.photo, camera.model, list(map(float, camera.params)), camera.viewmat] for camera in cameras.cameras
        ],
        "points": [cameras.points, cameras.point_colors],
        "label maps": [[file.name, read_label_map(file)] for file in maps],
        **{file.name: file.read_bytes().hex() for file in sorted(gaussians.iterdir())},
        "psnr": _psnr(project),
        "objects": sorted(objects_of(project).items()),
        "report": (project / "report" / "report.html").stat().st_size > 1000,
    }
    return {name: _hash(value) for name, value in parts.items()}


def files_of(project: Path) -> set[str]:
    """Return the names of all files of a project."""
    return {str(file.relative_to(project)) for file in _files(project)}


def leftovers(project: Path) -> list[str]:
    """Return the files under a temporary name that the end of a command left; nothing of ours begins with a dot."""
    return [name for name in files_of(project) if any(part.startswith(".") for part in Path(name).parts)]


def _psnr(project: Path) -> float:
    """Return the PSNR of the test photos in dB."""
    record = ProjectFolder.open_existing(project).stage_record("training")
    assert record is not None
    return float(record["figures"]["psnr"])
