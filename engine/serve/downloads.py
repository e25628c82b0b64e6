"""Files that leave a project: exports made by the engine, and the report."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

from fastapi.responses import FileResponse

from ..errors import HeritageError, ProjectError
from ..events import ErrorEvent, from_json_line
from ..files import delete_derived, object_file
from ..project_content import report_file, scene_file
from ..records import MUSEUM_RECORD_FILE, RECORD_FILE
from ..visible_text import visible
from .library import NotFound, WebProject

__all__ = ["MEDIA_TYPES", "download_name", "export", "export_path", "report_response"]

MEDIA_TYPES = {
    "ply": "application/octet-stream",
    "glb": "model/gltf-binary",
    "sog": "application/zip",
    "html": "text/html",
}
_ROOT = Path(__file__).resolve().parents[2]
_MAX_SECONDS = 600
_UNSAFE = re.compile(r"[^\w.() -]+")
_MAX_NAME = 100


def export_path(project: WebProject, object_id: str | None, file_format: str, frame: str = "upright") -> Path:
    """Return where the export of the scene (None) or of an object is kept; another place after each change.

    With the frame ``world``, that of the cameras, the file is for the viewer and holds far Gaussians, too.

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
    key = hashlib.sha256(repr((object_id, file_format, frame, project.title, changed)).encode()).hexdigest()[:16]
    return project.cache / f"{_stem(object_id, frame)}-{key}.{file_format}"


def export(project: WebProject, object_id: str | None, file_format: str, frame: str = "upright") -> Path:
    """Write an export where `export_path` says, unless it is there, and return its path.

    Raises
    ------
    HeritageError
        When there is no such object, or it cannot be exported.
    """
    file = export_path(project, object_id, file_format, frame)
    if not file.exists():
        project.cache.mkdir(exist_ok=True)
        for old in project.cache.glob(f"{_stem(object_id, frame)}-*.{file_format}"):
            delete_derived(project.cache, old.name)
        _export(project, object_id, file_format, frame, file)
    return file


def _stem(object_id: str | None, frame: str) -> str:
    return f"scene-{frame}" if object_id is None else f"object-{object_id}-{frame}"


def _export(project: WebProject, object_id: str | None, file_format: str, frame: str, file: Path) -> None:
    # -P: a file in the current folder must not pass for a module of ours.
    command = [sys.executable, "-P", "-m", "engine", "export", str(project.project), f"--format={file_format}"]
    command += [f"--out={file}", f"--frame={frame}", f"--title={visible(project.title)}", "--events"]
    command += ["--far=keep"] if frame == "world" else []
    command += [] if object_id is None else [f"--object={object_id}"]
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "PYTHONSAFEPATH": "1"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=_MAX_SECONDS, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ProjectError(f"The export took more than {_MAX_SECONDS} seconds. Export it in Blender.") from error
    if done.returncode:
        events = [from_json_line(line) for line in done.stdout.splitlines()]
        sentences = [event.message for event in events if isinstance(event, ErrorEvent)]
        raise HeritageError(sentences[-1] if sentences else "The export failed. The server's log has the details.")


def download_name(name: str, file_format: str) -> str:
    """Return the name of a downloaded file: the object's, without what file systems refuse."""
    stem = _UNSAFE.sub("_", name).strip(" .")[:_MAX_NAME]
    return f"{stem or 'object'}.{file_format}"


def report_response(project: WebProject) -> FileResponse:
    """Return the report of a project.

    Raises
    ------
    NotFound
        When there is none yet.
    """
    file = report_file(project.project)
    if not file.is_file():
        raise NotFound("The project has no report yet.")
    # The report is one file with its own styles and pictures, and no script.
    policy = "default-src 'none'; img-src data: 'self'; style-src 'unsafe-inline'; sandbox"
    return FileResponse(file, media_type="text/html", headers={"Content-Security-Policy": policy})
