"""Projects of the signed-in user."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from ..access import CurrentProject, CurrentUser, server_of
from ..contents import describe_project, summarise_project
from ..forecasts import forecast_of_presets
from ..reports import report_response
from ..streams import open_stream

__all__ = ["router"]

router = APIRouter(prefix="/projects", tags=["projects"])


class Title(BaseModel):
    """The user's name for a project."""

    title: str = Field(min_length=1, max_length=300, pattern=r"\S")


@router.get("")
def list_projects(request: Request, user: CurrentUser) -> list[dict[str, Any]]:
    """Return the projects, the newest first."""
    server = server_of(request)
    found = [summarise_project(server.queue, project) for project in server.library(user).projects()]
    return sorted(found, key=lambda one: str(one["created"]), reverse=True)


@router.post("", status_code=201)
def create_project(title: Title, request: Request, user: CurrentUser) -> dict[str, Any]:
    """Create an empty project."""
    server = server_of(request)
    return summarise_project(server.queue, server.library(user).create(title.title.strip()))


@router.get("/{project_id}")
def read_project(project: CurrentProject, request: Request) -> dict[str, Any]:
    """Return everything about a project."""
    return describe_project(server_of(request).queue, project)


@router.patch("/{project_id}")
def rename_project(title: Title, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Give a project another title."""
    project.rename(title.title.strip())
    return summarise_project(server_of(request).queue, project)


@router.delete("/{project_id}", status_code=204)
def delete_project(project: CurrentProject, request: Request, user: CurrentUser) -> None:
    """Stop what works on a project and move it to the server's trash."""
    server = server_of(request)
    server.queue.cancel_all(project.folder)
    server.library(user).discard(project)


@router.get("/{project_id}/events")
async def stream_events(project: CurrentProject, request: Request, user: CurrentUser) -> StreamingResponse:
    """Stream what happens in a project; ``Last-Event-ID`` continues an earlier stream."""
    return open_stream(server_of(request), project, user, request.headers.get("last-event-id", ""))


@router.get("/{project_id}/report")
def read_report(project: CurrentProject, request: Request) -> Any:
    """Return the report as a page of its own, as the objects are now; while a job runs, as they were before."""
    job = server_of(request).queue.last(project.folder)
    return report_response(project, is_busy=job is not None and job.state == "running")


@router.get("/{project_id}/forecast")
def read_forecast(project: CurrentProject, request: Request) -> dict[str, list[float]]:
    """Return low, expected and high seconds of a reconstruction of the photos, by preset."""
    return forecast_of_presets(project, server_of(request).settings)
