"""Files that leave a project: exports made by the engine."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..core.files import delete_derived, object_file
from ..core.visible_text import visible
from ..formats import FORMATS, format_of
from ..project.content import scene_file
from ..project.objects import MUSEUM_RECORD_FILE, RECORD_FILE
from .engine_call import call_engine
from .library import NotFound, WebProject

DOWNLOADS = tuple(
    one for one in FORMATS if one.write is not None or one.is_page or (one.write_mesh is not None and not one.beside)
)
"""The formats in which the scene and objects can be had, meshes of objects alone, each as one file."""
if TYPE_CHECKING:
    DownloadFormat = str
else:
    DownloadFormat = Literal[tuple(one.name for one in DOWNLOADS)]
_UNSAFE = re.compile(r"[^\w.() -]+")
_MAX_NAME = 100
_KEY_LENGTH = 16


def export_path(
    project: WebProject, object_id: str | None, file_format: DownloadFormat, frame: str = "upright"
) -> Path:
    """Return where the export of the scene (None) or of an object is kept; another place after each change.

    With the frame ``world``, that of the cameras, the file is for the viewer: with far Gaussians, without a record.

    Raises
    ------
    NotFound
        When there is no such object.
    """
    sources = [scene_file(project.project)]
    if object_id is not None:
        # The file carries what a curator entered, too.
        names = (RECORD_FILE, MUSEUM_RECORD_FILE)
        sources += [object_file(project.project, object_id, name) for name in names]
        if not sources[1].is_file():
            raise NotFound("There is no such object.")
    changed = [file.stat().st_mtime_ns for file in sources if file.is_file()]
    stated = repr((object_id, file_format, frame, project.title, changed))
    key = hashlib.sha256(stated.encode()).hexdigest()[:_KEY_LENGTH]
    return project.cache / f"{_stem(object_id, frame)}-{file_format}-{key}{format_of(file_format).suffixes[0]}"


def export(project: WebProject, object_id: str | None, file_format: DownloadFormat, frame: str = "upright") -> Path:
    """Write an export where `export_path` says, unless it is there, and return its path.

    Raises
    ------
    HeritageError
        When there is no such object, or it cannot be exported.
    """
    file = export_path(project, object_id, file_format, frame)
    if not file.exists():
        project.cache.mkdir(exist_ok=True)
        for old in project.cache.glob(f"{_stem(object_id, frame)}-{file_format}-{'?' * _KEY_LENGTH}.*"):
            delete_derived(project.cache, old.name)
        _export(project, object_id, file_format, frame, file)
    return file


def _stem(object_id: str | None, frame: str) -> str:
    return f"scene-{frame}" if object_id is None else f"object-{object_id}-{frame}"


def _export(project: WebProject, object_id: str | None, file_format: str, frame: str, file: Path) -> None:
    arguments = ["export", str(project.project), f"--format={file_format}", f"--out={file}", f"--frame={frame}"]
    arguments += [f"--title={visible(project.title)}"]
    arguments += ["--far=keep", "--record=none"] if frame == "world" else []
    arguments += [] if object_id is None else [f"--object={object_id}"]
    call_engine(arguments, "export")


def download_name(name: str, file_format: str) -> str:
    """Return the name of a downloaded file: the object's, without what file systems refuse."""
    stem = _UNSAFE.sub("_", name).strip(" .")[:_MAX_NAME]
    return f"{stem or 'object'}{format_of(file_format).suffixes[0]}"
