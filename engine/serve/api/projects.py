"""Projects of the signed-in user."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, Field

from ...core.errors import ProjectError
from ...project.folder import ProjectFolder
from ...project.own_words import set_learning
from ..access import CurrentProject, CurrentUser, server_of
from ..contents import describe_project, has_scene, summarise_project
from ..reports import report_response
from ..texts import Line

router = APIRouter(prefix="/projects", tags=["projects"])


class Title(BaseModel):
    """The user's name for a project."""

    title: Line = Field(min_length=1, max_length=300, pattern=r"\S")


class Learning(BaseModel):
    """Whether a project teaches and uses the words of its user's own objects."""

    learns: bool


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
    server = server_of(request)
    return describe_project(server.queue, project, server.settings)


@router.patch("/{project_id}")
def rename_project(title: Title, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Give a project another title."""
    project.rename(title.title.strip())
    return summarise_project(server_of(request).queue, project)


@router.put("/{project_id}/learning", status_code=204)
def set_project_learning(wanted: Learning, project: CurrentProject, request: Request) -> None:
    """Let a project teach and use the words of its user's own objects, or neither."""
    if not has_scene(project):
        raise ProjectError("The scene is not reconstructed yet.")
    with ProjectFolder.open_existing(project.project) as opened:
        set_learning(opened, wanted.learns)
    server_of(request).feeds.publish(project.folder, "objects")


@router.delete("/{project_id}", status_code=204)
def delete_project(project: CurrentProject, request: Request, user: CurrentUser) -> None:
    """Stop what works on a project and move it to the trash of the user."""
    server = server_of(request)
    server.queue.cancel_all(project.folder)
    server.library(user).discard(project)


@router.get("/{project_id}/events")
async def stream_events(
    project: CurrentProject, request: Request, user: CurrentUser, browser: Annotated[str, Query(max_length=64)] = ""
) -> StreamingResponse:
    """Stream what happens in a project; ``Last-Event-ID`` continues an earlier stream.

    ``browser`` is the browser's name for itself: of its streams, only the newest few stay open.
    """
    return server_of(request).streams.begin(project, user, request.headers.get("last-event-id", ""), browser)


@router.get("/{project_id}/report")
async def read_report(
    project: CurrentProject, request: Request, language: Annotated[str, Query(pattern="^[a-z]{2}$")] = "en"
) -> FileResponse:
    """Return the report as a page of its own, as the objects are now; while a job runs, as they were before."""
    server = server_of(request)
    job = await run_in_threadpool(server.queue.last, project.folder)
    await server.work.report(project, is_busy=job is not None and job.state == "running")
    return report_response(project, language)


@router.get("/{project_id}/forecast")
async def read_forecast(project: CurrentProject, request: Request) -> dict[str, list[float]]:
    """Return low, expected and high seconds of a reconstruction of the photos, by preset."""
    return await server_of(request).work.forecast(project)
