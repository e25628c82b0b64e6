"""The uploaded photos and videos of a project."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from ..access import CurrentProject, CurrentUser, server_of
from ..conditional import file_answer
from ..small_photos import SMALL_SIDE, small_photo

__all__ = ["router", "videos"]

router = APIRouter(prefix="/projects/{project_id}/photos", tags=["photos"])
videos = APIRouter(prefix="/projects/{project_id}/videos", tags=["photos"])


@router.get("/{name}")
def read_photo(
    name: str, project: CurrentProject, request: Request, side: Annotated[int, Query(ge=1, le=1600)] = SMALL_SIDE
) -> Response:
    """Return a small JPEG of a photo, upright."""
    return file_answer(request, small_photo(project.photo(name), project.cache, side), "image/jpeg")


@videos.delete("/{name}", status_code=204)
def delete_video(name: str, project: CurrentProject, request: Request, user: CurrentUser) -> None:
    """Delete an uploaded video; the photos that were taken from it stay."""
    server = server_of(request)
    server.library(user).delete_video(project, name)
    server.feeds.publish(project.folder, "photos")


@router.delete("/{name}", status_code=204)
def delete_photo(name: str, project: CurrentProject, request: Request, user: CurrentUser) -> None:
    """Delete an uploaded photo."""
    server = server_of(request)
    server.library(user).delete_photo(project, name)
    server.feeds.publish(project.folder, "photos")
