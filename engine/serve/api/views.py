"""Data for the viewer: the scene, its cameras, the photos to click on, and the live picture of the training."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from ...core.files import path_within
from ...delivery.records import describe_unit
from ...formats import format_of
from ...project.folder import ProjectFolder
from ...project.refused_prompts import read_not_found
from ...scene import Camera, focal_and_center, looked_at, photo_pixels, read_camera_set
from ..access import CurrentProject, server_of
from ..conditional import file_answer
from ..downloads import DownloadFormat, download_name
from ..library import NotFound
from ..small_photos import LARGE_SIDE
from ..texts import Line

router = APIRouter(prefix="/projects/{project_id}", tags=["views"])
_Number = Annotated[float, Query(ge=-1e9, le=1e9, allow_inf_nan=False)]
_UP = (0.0, 0.0, 1.0)
"""The engine turns scenes so that Z is up."""


@router.get("/preview.png")
def read_preview(project: CurrentProject, request: Request) -> FileResponse:
    """Return the newest picture of the training."""
    path = server_of(request).queue.preview(project.folder)
    folder = project.project.resolve()
    file = folder.joinpath(path) if path else folder
    if not file.is_file() or not file.resolve().is_relative_to(folder):
        raise NotFound("There is no picture of the training yet.")
    return FileResponse(file, media_type="image/png", headers={"Cache-Control": "no-store"})


class Question(BaseModel):
    """Words for things in a scene that is being trained."""

    prompt: Line = Field(min_length=1, pattern=r"\S")


@router.post("/ask")
async def ask_scene(question: Question, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Return what the scene so far shows of what words name, with pictures; nothing is stored."""
    server = server_of(request)
    server.settings.require_short(question.prompt)
    return await server.work.answers(project, question.prompt)


@router.get("/cameras")
def read_cameras(project: CurrentProject) -> dict[str, Any]:
    """Return the cameras of the photos, the point that they look at, its distance, up, and the unit of length.

    COLMAP's cameras: x right, y down, z forward; ``world_to_camera`` has 16 numbers, row by row.
    """
    cameras = read_camera_set(path_within(project.project, "cameras")).cameras
    if not cameras:
        raise NotFound("The scene has no cameras.")
    center, radius = looked_at(np.array([camera.viewmat for camera in cameras], np.float64))
    unit = describe_unit(ProjectFolder.open_existing(project.project))
    return {
        "up": _UP, "center": center, "radius": radius, "views": [_view(camera) for camera in cameras],
        "unit": {"metresPerUnit": unit["metres_per_unit"], "text": unit["text"]},
    }  # fmt: skip


@router.get("/views/{photo}")
async def read_view(
    photo: str, project: CurrentProject, request: Request, side: Annotated[int, Query(ge=1, le=LARGE_SIDE)] = LARGE_SIDE
) -> Response:
    """Return the photo that clicks refer to, upright, with its lens distortion."""
    small = await server_of(request).work.small_photo(
        await run_in_threadpool(project.photo, photo), project.cache, side
    )
    return file_answer(request, small, "image/jpeg")


@router.get("/views/{photo}/pixel")
def read_pixel(photo: str, project: CurrentProject, x: _Number, y: _Number, z: _Number) -> dict[str, float] | None:
    """Return where a photo shows a point of the scene, in pixels after EXIF rotation; null where it does not.

    What may hide the point is not looked at.
    """
    camera = read_camera_set(path_within(project.project, "cameras")).by_photo.get(photo)
    if camera is None:
        raise NotFound(f"There is no camera of {photo!r}.")
    local = np.asarray(camera.viewmat)[:3, :3] @ (x, y, z) + np.asarray(camera.viewmat)[:3, 3]
    if local[2] <= 0:
        return None
    pixel = photo_pixels(camera, local[None, :2] / local[2])[0]
    inside = bool((pixel >= 0).all() and (pixel < (camera.width, camera.height)).all())  # NaN is outside
    return {"x": round(float(pixel[0]), 1), "y": round(float(pixel[1]), 1)} if inside else None


@router.get("/candidates/{number}.png")
def read_candidate(number: int, project: CurrentProject) -> FileResponse:
    """Return the picture of a candidate for words that were not found."""
    not_found = read_not_found(project.project)
    candidates = () if not_found is None else not_found.candidates
    picture = next((one.picture for one in candidates if one.number == number), None)
    if picture is None or not picture.is_file():
        raise NotFound("There is no such candidate.")
    return FileResponse(picture, media_type="image/png", headers={"Cache-Control": "no-store"})


@router.get("/scene.ply")
async def read_scene(project: CurrentProject, request: Request) -> Response:
    """Return the scene for the viewer, in the frame of the cameras."""
    file = await server_of(request).work.exported(project, None, "ply", "world")
    return file_answer(request, file, format_of("ply").media_type)


@router.get("/export")
async def download_scene(
    project: CurrentProject,
    request: Request,
    file_format: Annotated[DownloadFormat, Query(alias="format")],
) -> FileResponse:
    """Return the whole scene as a file to keep."""
    file = await server_of(request).work.exported(project, None, file_format)
    return FileResponse(
        file, media_type=format_of(file_format).media_type, filename=download_name(project.title, file_format)
    )


def _view(camera: Camera) -> dict[str, Any]:
    fx, fy, cx, cy = focal_and_center(camera)
    return {
        "photo": camera.photo, "width": camera.width, "height": camera.height,
        "fx": fx, "fy": fy, "cx": cx, "cy": cy, "world_to_camera": np.asarray(camera.viewmat).ravel().tolist(),
    }  # fmt: skip
