"""Resumable uploads by the tus protocol (https://tus.io), version 1.0.0, with `tuspyserver`.

Unfinished uploads are in a folder of the user outside of what is served. A complete one is checked at once, see
`intake`; the answer to its last request says whether it was taken.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.concurrency import run_in_threadpool
from tuspyserver import create_tus_router

from ...files import delete_derived
from ..access import CurrentUser, current_user, server_of
from ..intake import is_video, is_video_name, photo_name, take_in_photo, take_in_video
from ..settings import ServeSettings
from ..videos import frames_arguments

__all__ = ["upload_router"]

_UPLOAD_ID = re.compile(r"[0-9a-f-]{32,36}")
_UNSUPPORTED = ("upload-concat", "upload-defer-length", "x-http-method-override")
"""Extensions of the protocol by which a client could pass the limits."""


def upload_router(settings: ServeSettings) -> APIRouter:
    """Return the routes of uploads."""
    router = APIRouter(tags=["uploads"], dependencies=[Depends(current_user), Depends(_require_supported)])
    # Its annotations leave out that the functions may be coroutines and may name a folder.
    hooks: dict[str, Any] = {"pre_create_dep": _before, "upload_complete_dep": _when_complete, "file_dep": _folder}
    router.include_router(
        create_tus_router(
            prefix="/uploads",
            files_dir=str(settings.data / "uploads"),
            max_size=settings.max_video_bytes,
            days_to_keep=settings.upload_days,
            strict_offset_validation=True,
            **hooks,
        )
    )
    return router


def _require_supported(request: Request) -> None:
    for name in _UNSUPPORTED:
        if name in request.headers:
            raise HTTPException(400, f"The header {name} is not supported.")
    upload_id = request.path_params.get("uuid")
    if upload_id is not None and not _UPLOAD_ID.fullmatch(upload_id):
        raise HTTPException(404, "There is no such upload.")


def _folder(request: Request, user: CurrentUser) -> Callable[[dict[str, Any]], dict[str, str]]:
    """Return a function that names the folder of the user's unfinished uploads."""
    folder = server_of(request).library(user).uploads
    folder.mkdir(parents=True, exist_ok=True)
    return lambda _: {"files_dir": str(folder)}


def _before(request: Request, user: CurrentUser) -> Callable[[dict[str, Any], dict[str, Any]], Awaitable[None]]:
    """Return a function that refuses an upload before its first byte."""
    server = server_of(request)
    library = server.library(user)

    def check(metadata: dict[str, Any], upload: dict[str, Any]) -> None:
        library.project(str(metadata.get("project", "")))
        name = photo_name(str(metadata.get("filename", "")))
        size = upload.get("size")
        if not isinstance(size, int) or size <= 0:
            raise HTTPException(400, "The file is empty.")
        limit = server.settings.max_video_bytes if is_video_name(name) else server.settings.max_photo_bytes
        if size > limit:
            raise HTTPException(413, f"{name} is larger than {limit / 1e6:,.0f} MB.")
        library.require_space(size)
        n_open = sum(1 for _ in library.uploads.glob("*.info")) if library.uploads.is_dir() else 0
        if n_open >= server.settings.max_open_uploads:
            raise HTTPException(429, f"{n_open} uploads have begun and not ended. End some of them first.")

    async def before(metadata: dict[str, Any], upload: dict[str, Any]) -> None:
        await run_in_threadpool(check, metadata, upload)

    return before


def _when_complete(request: Request, user: CurrentUser) -> Callable[[str, dict[str, Any]], Awaitable[None]]:
    """Return a function that takes a complete upload into its project."""
    server = server_of(request)
    library = server.library(user)

    def take_in(path: str, metadata: dict[str, Any]) -> None:
        file = Path(path)
        try:
            project = library.project(str(metadata.get("project", "")))
            filename = str(metadata.get("filename", ""))
            if is_video(file, filename):
                video = take_in_video(project, file, filename)
                server.queue.submit(project, frames_arguments(project, video))
            else:
                take_in_photo(project, file, filename, server.settings)
        finally:
            delete_derived(library.uploads, file.name)
            delete_derived(library.uploads, f"{file.name}.info")
        server.feeds.publish(project.folder, "photos")

    async def complete(path: str, metadata: dict[str, Any]) -> None:
        await run_in_threadpool(take_in, path, metadata)

    return complete
