"""The uploaded photos of a project."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from ..access import CurrentProject, server_of
from ..conditional import file_answer
from ..contents import describe_removed
from ..small_photos import LARGE_SIDE, SMALL_SIDE

router = APIRouter(prefix="/projects/{project_id}/photos", tags=["photos"])


@router.get("/{name}")
async def read_photo(
    name: str, project: CurrentProject, request: Request, side: Annotated[int, Query(ge=1, le=LARGE_SIDE)] = SMALL_SIDE
) -> Response:
    """Return a small JPEG of a photo, upright."""
    file = await server_of(request).work.small_photo(await run_in_threadpool(project.photo, name), project.cache, side)
    return file_answer(request, file, "image/jpeg")


@router.delete("/{name}")
def delete_photo(name: str, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Move an uploaded photo or video to the trash of the project; the ``id`` brings it back from there."""
    item = project.remove(name)
    server_of(request).feeds.publish(project.folder, "photos")
    return describe_removed(item)
