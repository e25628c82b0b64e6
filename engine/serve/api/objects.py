"""Isolated objects: names, records, files to download."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from ...core.files import object_file
from ...formats import format_of
from ...project.content import ProjectObject, shown_objects
from ...project.folder import ProjectFolder
from ...project.objects import (
    RECORD_FILE,
    delete_object,
    load_membership,
    load_record,
    read_record,
    rename_object,
    save_record,
)
from ..access import CurrentProject, server_of
from ..conditional import file_answer
from ..contents import describe_object
from ..downloads import DownloadFormat, download_name
from ..library import NotFound, WebProject
from ..texts import Line, Lines
from ..thumbnails import object_thumbnail

router = APIRouter(prefix="/projects/{project_id}/objects", tags=["objects"])
_Text = Annotated[Line | None, Field(max_length=300)]


class ObjectChange(BaseModel):
    """The name of an object and its museum record; what is not given stays."""

    name: Annotated[Line | None, Field(min_length=1, max_length=300)] = None
    title: _Text = None
    catalogue_number: _Text = None
    rights: _Text = None
    notes: Annotated[Lines | None, Field(max_length=5000)] = None


@router.get("/{object_id}.ply")
async def read_object_for_viewer(object_id: str, project: CurrentProject, request: Request) -> Response:
    """Return an object for the viewer, in the frame of the cameras."""
    await run_in_threadpool(_object, project, object_id)
    file = await server_of(request).work.exported(project, object_id, "ply", "world")
    return file_answer(request, file, format_of("ply").media_type)


@router.get("/{object_id}/thumbnail.jpg")
async def read_thumbnail(object_id: str, project: CurrentProject, request: Request) -> Response:
    """Return a small picture of an object, of the photo that it was found in."""
    await run_in_threadpool(_object, project, object_id)
    file = await server_of(request).work.picture(lambda: object_thumbnail(project, object_id))
    return file_answer(request, file, "image/jpeg")


@router.get("/{object_id}/members")
def read_members(object_id: str, project: CurrentProject) -> Response:
    """Return which Gaussians of the scene belong to an object.

    A bit for each Gaussian in the order of the scene's PLY for the viewer, the lowest bit of each byte first; the
    header ``X-Count`` has their number.
    """
    _object(project, object_id)
    record = read_record(object_file(project.project, object_id, RECORD_FILE))
    count = record.n_scene_gaussians
    members = load_membership(project.project, object_id, count) >= record.threshold
    bits = np.packbits(members, bitorder="little").tobytes()
    headers = {"X-Count": str(count), "Cache-Control": "no-cache"}
    return Response(bits, media_type="application/octet-stream", headers=headers)


@router.get("/{object_id}/export")
async def download_object(
    object_id: str,
    project: CurrentProject,
    request: Request,
    file_format: Annotated[DownloadFormat, Query(alias="format")],
) -> FileResponse:
    """Return an object as a file to keep."""
    item = await run_in_threadpool(_object, project, object_id)
    file = await server_of(request).work.exported(project, object_id, file_format)
    return FileResponse(
        file, media_type=format_of(file_format).media_type, filename=download_name(item.name, file_format)
    )


@router.patch("/{object_id}")
def change_object(object_id: str, change: ObjectChange, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Change the name or the record of an object."""
    _object(project, object_id)
    values = change.model_dump(exclude_none=True)
    with ProjectFolder.open_existing(project.project) as opened:
        name = values.pop("name", None)
        if name is not None:
            rename_object(opened.path, object_id, name.strip())
        if values:
            save_record(opened.path, object_id, replace(load_record(opened.path, object_id), **values))
    server_of(request).feeds.publish(project.folder, "objects")
    return describe_object(project, _object(project, object_id))


@router.delete("/{object_id}", status_code=204)
def remove_object(object_id: str, project: CurrentProject, request: Request) -> None:
    """Move an object to the project's trash."""
    _object(project, object_id)
    with ProjectFolder.open_existing(project.project) as opened:
        delete_object(opened, object_id, why="deleted on the web page")
    server_of(request).feeds.publish(project.folder, "objects")


def _object(project: WebProject, object_id: str) -> ProjectObject:
    item = next((one for one in shown_objects(project.project) if one.id == object_id), None)
    if item is None:
        raise NotFound("There is no such object.")
    return item
