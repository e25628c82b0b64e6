"""The trash of a user: shown, brought back, deleted for good."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request

from ..access import CurrentProject, CurrentUser, server_of
from ..contents import describe_removed, summarise_project
from ..writers import only_writer

router = APIRouter(tags=["trash"])


@router.get("/trash")
def list_deleted_projects(request: Request, user: CurrentUser) -> list[dict[str, Any]]:
    """Return the deleted projects, the last deleted first."""
    library = server_of(request).library(user)
    return [{**describe_removed(item), "title": project.title} for item, project in library.deleted_projects()]


@router.delete("/trash", status_code=204)
def empty_trash(request: Request, user: CurrentUser) -> None:
    """Delete for good what was removed, in all projects too."""
    server_of(request).library(user).empty_trash()


@router.post("/trash/{item_id}/restore")
def restore_project(item_id: str, request: Request, user: CurrentUser) -> dict[str, Any]:
    """Bring a deleted project back."""
    server = server_of(request)
    return summarise_project(server.queue, server.library(user).restore(item_id))


@router.get("/projects/{project_id}/trash")
def list_removed(project: CurrentProject) -> list[dict[str, Any]]:
    """Return the removed photos and videos of a project, the last removed first."""
    return [describe_removed(item) for item in project.trash.items()]


@router.post("/projects/{project_id}/trash/{item_id}/restore")
def restore_photo(item_id: str, project: CurrentProject, request: Request) -> dict[str, str]:
    """Bring a removed photo or video back, and return its name."""
    name = project.restore(item_id)
    server_of(request).feeds.publish(project.folder, "photos")
    return {"name": name}


@router.delete("/projects/{project_id}/trash", status_code=204)
def empty_project_trash(project: CurrentProject) -> None:
    """Delete for good what was removed in a project."""
    with only_writer(project.folder):
        project.trash.empty()
