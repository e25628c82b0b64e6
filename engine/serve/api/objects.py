"""Isolated objects: names, records, files to download."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from ...project_content import ProjectObject, list_objects
from ...project_folder import ProjectFolder
from ...records import delete_object, load_record, rename_object, save_record
from ..access import CurrentProject, server_of
from ..contents import describe_object
from ..downloads import MEDIA_TYPES, download_name
from ..library import NotFound, WebProject
from ..texts import Line, Lines

__all__ = ["router"]

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
async def read_object_for_viewer(object_id: str, project: CurrentProject, request: Request) -> FileResponse:
    """Return an object for the viewer, in the frame of the cameras."""
    await run_in_threadpool(_object, project, object_id)
    file = await server_of(request).work.exported(project, object_id, "ply", "world")
    return FileResponse(file, media_type=MEDIA_TYPES["ply"])


@router.get("/{object_id}/export")
async def download_object(
    object_id: str,
    project: CurrentProject,
    request: Request,
    file_format: Annotated[Literal["ply", "glb", "sog", "html"], Query(alias="format")],
) -> FileResponse:
    """Return an object as a file to keep."""
    item = await run_in_threadpool(_object, project, object_id)
    file = await server_of(request).work.exported(project, object_id, file_format)
    return FileResponse(file, media_type=MEDIA_TYPES[file_format], filename=download_name(item.name, file_format))


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
    item = next((one for one in list_objects(project.project) if one.id == object_id), None)
    if item is None:
        raise NotFound("There is no such object.")
    return item
