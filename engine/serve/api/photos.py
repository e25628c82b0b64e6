"""The uploaded photos of a project."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse

from ..access import CurrentProject, CurrentUser, server_of
from ..small_photos import SMALL_SIDE, small_photo

__all__ = ["router"]

router = APIRouter(prefix="/projects/{project_id}/photos", tags=["photos"])
_CACHE = {"Cache-Control": "private, max-age=3600"}


@router.get("/{name}")
def read_photo(
    name: str, project: CurrentProject, side: Annotated[int, Query(ge=1, le=1600)] = SMALL_SIDE
) -> FileResponse:
    """Return a small JPEG of a photo, upright."""
    file = small_photo(project.photo(name), project.cache, side)
    return FileResponse(file, media_type="image/jpeg", headers=_CACHE)


@router.delete("/{name}", status_code=204)
def delete_photo(name: str, project: CurrentProject, request: Request, user: CurrentUser) -> None:
    """Delete an uploaded photo."""
    server = server_of(request)
    server.library(user).delete_photo(project, name)
    server.feeds.publish(project.folder, "photos")
