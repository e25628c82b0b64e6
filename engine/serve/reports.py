"""The report of a project, as the objects are now."""

from __future__ import annotations

import hashlib
import threading

from fastapi.responses import FileResponse

from ..errors import FormatError
from ..files import object_file, read_json, write_json
from ..project_content import list_objects, report_file, scene_file
from ..records import RECORD_FILE
from .engine_call import call_engine
from .library import NotFound, WebProject

__all__ = ["report_response"]

_STAMP = "report.json"
_SCHEMA = {"made_from": str}
_one_report = threading.Lock()


def report_response(project: WebProject, *, is_busy: bool) -> FileResponse:
    """Return the report of a project; it is made anew where the objects or the title changed after it.

    Parameters
    ----------
    project : WebProject
    is_busy : bool
        Whether a job works on the project, which then may not be changed: the report is that from before.

    Raises
    ------
    NotFound
        When there is none yet.
    HeritageError
        When it cannot be made.
    """
    file = report_file(project.project)
    if not file.is_file():
        raise NotFound("The project has no report yet.")
    with _one_report:
        key = _key(project)
        if not is_busy and _stored_key(project) != key:
            call_engine(["report", str(project.project), f"--title={project.title}"], "report")
            project.cache.mkdir(exist_ok=True)
            write_json(project.cache / _STAMP, {"made_from": key})
    # The report is one file with its own styles and pictures, and no script.
    policy = "default-src 'none'; img-src data: 'self'; style-src 'unsafe-inline'; sandbox"
    headers = {"Content-Security-Policy": policy, "Cache-Control": "no-cache"}
    return FileResponse(file, media_type="text/html", headers=headers)


def _key(project: WebProject) -> str:
    """Return a hash of what the report shows and may change without a reconstruction."""
    records = [object_file(project.project, one.id, RECORD_FILE) for one in list_objects(project.project)]
    files = [scene_file(project.project), *records]
    changed = [(file.parent.name, file.stat().st_mtime_ns) for file in files]
    return hashlib.sha256(repr((project.title, changed)).encode()).hexdigest()


def _stored_key(project: WebProject) -> str:
    file = project.cache / _STAMP
    try:
        return str(read_json(file, _SCHEMA, advice="Delete it.")["made_from"]) if file.is_file() else ""
    except FormatError:
        return ""  # damaged, so the report is made anew
