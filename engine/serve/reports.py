"""The report of a project, as the objects are now."""

from __future__ import annotations

import hashlib

from fastapi.responses import FileResponse

from ..core.errors import FormatError
from ..core.files import object_file, read_json, write_json
from ..core.visible_text import visible
from ..project.content import readable_report, report_file, scene_file, shown_objects
from ..project.objects import RECORD_FILE
from .engine_call import call_engine
from .library import NotFound, WebProject

_STAMP = "report.json"
_SCHEMA = {"made_from": str}


def is_current(project: WebProject) -> bool:
    """Return whether neither the objects nor the title changed since the report was made.

    Raises
    ------
    NotFound
        When there is none yet.
    """
    if not report_file(project.project).is_file():
        raise NotFound("The project has no report yet.")
    return _stored_key(project) == _key(project)


def make_report(project: WebProject) -> None:
    """Make the report anew, unless it is current.

    Raises
    ------
    NotFound
        When there is none yet.
    HeritageError
        When it cannot be made.
    """
    if is_current(project):
        return
    key = _key(project)
    call_engine(["report", str(project.project), f"--title={visible(project.title)}"], "report")
    project.cache.mkdir(exist_ok=True)
    write_json(project.cache / _STAMP, {"made_from": key})


def report_response(project: WebProject, language: str) -> FileResponse:
    """Return the report of a project in a language, by its code, as an answer that runs no script."""
    # The report is one file with its own styles and pictures.
    policy = "default-src 'none'; img-src data: 'self'; style-src 'unsafe-inline'; sandbox"
    headers = {"Content-Security-Policy": policy, "Cache-Control": "no-cache"}
    return FileResponse(readable_report(project.project, language), media_type="text/html", headers=headers)


def _key(project: WebProject) -> str:
    """Return a hash of what the report shows and may change without a reconstruction."""
    records = [object_file(project.project, one.id, RECORD_FILE) for one in shown_objects(project.project)]
    files = [scene_file(project.project), *records]
    changed = [(file.parent.name, file.stat().st_mtime_ns) for file in files]
    return hashlib.sha256(repr((project.title, changed)).encode()).hexdigest()


def _stored_key(project: WebProject) -> str:
    file = project.cache / _STAMP
    try:
        return str(read_json(file, _SCHEMA, advice="Delete it.")["made_from"]) if file.is_file() else ""
    except FormatError:
        return ""  # damaged, so the report is made anew
