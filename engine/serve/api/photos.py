"""The uploaded photos of a project."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse

from ..access import CurrentProject, server_of
from ..contents import describe_removed
from ..small_photos import SMALL_SIDE

__all__ = ["router"]

router = APIRouter(prefix="/projects/{project_id}/photos", tags=["photos"])
_CACHE = {"Cache-Control": "private, max-age=3600"}


@router.get("/{name}")
async def read_photo(
    name: str, project: CurrentProject, request: Request, side: Annotated[int, Query(ge=1, le=1600)] = SMALL_SIDE
) -> FileResponse:
    """Return a small JPEG of a photo, upright."""
    file = await server_of(request).work.small_photo(await run_in_threadpool(project.photo, name), project.cache, side)
    return FileResponse(file, media_type="image/jpeg", headers=_CACHE)


@router.delete("/{name}")
def delete_photo(name: str, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Move an uploaded photo or video to the trash of the project; the ``id`` brings it back from there."""
    item = project.remove(name)
    server_of(request).feeds.publish(project.folder, "photos")
    return describe_removed(item)
