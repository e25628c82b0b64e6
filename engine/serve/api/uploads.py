"""Resumable uploads by the tus protocol (https://tus.io), version 1.0.0: core, creation and termination.

Unfinished uploads are in a folder of the user outside of what is served. A complete one is checked at once, see
`intake`; the answer to its last request says whether it was taken. Nothing here waits in the event loop, and nothing
holds more than `_PART` bytes of an upload.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import re
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Depends, Header, HTTPException, Request, Response

from ...core.errors import DiskError, FormatError, HeritageError, ProjectError
from ...core.files import file_sha256
from ..access import CurrentUser, Server, current_user, server_of
from ..guards import TUS_VERSION, UPLOADS
from ..intake import is_video, is_video_name, photo_name, take_in_photo, take_in_video
from ..unfinished import Upload
from ..videos import frames_arguments

_EXTENSIONS = "creation,termination"
_CONTENT_TYPE = "application/offset+octet-stream"
_UNSUPPORTED = ("upload-concat", "upload-defer-length", "x-http-method-override")
"""Extensions of the protocol by which a client could pass the limits."""
_PART = 256 << 10
"""Bytes that are collected before they are written."""
_SHA256 = re.compile(r"[0-9a-f]{64}")
_MAX_DIGITS = 18

Text = Annotated[str, Header()]


def _require_supported(request: Request) -> None:
    for name in _UNSUPPORTED:
        if name in request.headers:
            raise HTTPException(400, f"The header {name} is not supported.")
    version = request.headers.get("tus-resumable", "")
    if request.method != "OPTIONS" and version != TUS_VERSION:
        raise HTTPException(412, f"The header Tus-Resumable must be {TUS_VERSION}.", {"Tus-Version": TUS_VERSION})


router = APIRouter(
    prefix="/uploads", tags=["uploads"], dependencies=[Depends(current_user), Depends(_require_supported)]
)


@router.options("", status_code=204, include_in_schema=False)
@router.options("/", status_code=204)
async def read_capabilities(request: Request) -> Response:
    """Return the version and extensions of the protocol, and the largest file."""
    size = server_of(request).settings.max_video_bytes
    headers = {"Tus-Version": TUS_VERSION, "Tus-Extension": _EXTENSIONS, "Tus-Max-Size": str(size)}
    return Response(status_code=204, headers=headers)


@router.post("", status_code=201, include_in_schema=False)
@router.post("/", status_code=201)
async def begin_upload(
    request: Request, user: CurrentUser, upload_length: Text = "", upload_metadata: Text = ""
) -> Response:
    """Begin an upload; a body is not read."""
    server = server_of(request)
    metadata = _metadata(upload_metadata)
    size = _number(upload_length, "Upload-Length")
    upload = await to_thread.run_sync(_begin, server, user, metadata, size, limiter=server.transfers.writers)
    return Response(status_code=201, headers={"Location": f"{UPLOADS}/{upload.id}", "Upload-Offset": "0"})


@router.head("/{uuid}", status_code=200)
async def read_offset(uuid: str, request: Request, user: CurrentUser) -> Response:
    """Return how much of an upload has arrived."""
    server = server_of(request)
    upload = _find(server, user, uuid)
    async with server.transfers.held(upload):
        _require_kept(server, user, upload)
        if upload.offset == upload.size:
            # The server ended, or the disk was full, before it was checked: a client takes this answer for the end.
            await _finish(server, user, upload)
        headers = {"Upload-Offset": str(upload.offset), "Upload-Length": str(upload.size), "Cache-Control": "no-store"}
    return Response(status_code=200, headers=headers)


@router.patch("/{uuid}", status_code=204)
async def continue_upload(
    uuid: str, request: Request, user: CurrentUser, upload_offset: Text = "", content_type: Text = ""
) -> Response:
    """Append bytes to an upload. The last ones make it a photo or video of its project, or refuse it."""
    server = server_of(request)
    upload = _find(server, user, uuid)
    if content_type != _CONTENT_TYPE:
        raise HTTPException(415, f"The header Content-Type must be {_CONTENT_TYPE}.")
    offset = _number(upload_offset, "Upload-Offset")
    async with server.transfers.held(upload) as wanted:
        _require_kept(server, user, upload)
        present = upload.offset
        if offset != present:
            # The header tells the client that this is no refusal of the file.
            raise HTTPException(409, f"The upload goes on at byte {present}.", {"Upload-Offset": str(present)})
        if offset + int(request.headers.get("content-length", "0")) > upload.size:
            raise HTTPException(413, "There is more than was announced.")
        if not upload.taken:
            await _receive(server, upload, offset, request, wanted)
        if upload.offset == upload.size:
            await _finish(server, user, upload)
        return Response(status_code=204, headers={"Upload-Offset": str(upload.offset)})


@router.delete("/{uuid}", status_code=204)
async def end_upload(uuid: str, request: Request, user: CurrentUser) -> Response:
    """Delete an unfinished upload."""
    server = server_of(request)
    upload = _find(server, user, uuid)
    async with server.transfers.held(upload):
        if not upload.taken:
            await to_thread.run_sync(server.uploads.forget, upload, limiter=server.transfers.writers)
    return Response(status_code=204)


async def _receive(server: Server, upload: Upload, offset: int, request: Request, wanted: asyncio.Future[None]) -> None:
    """Append the body of a request until it ends, breaks off, or another request wants to continue the upload.

    Raises
    ------
    HTTPException
        When there is more than was announced; nothing of this request is kept then.
    DiskError
        When the disk is full; what was written before is kept.
    """
    begin, held, more = offset, bytearray(), True
    while more:
        receiving = asyncio.ensure_future(request.receive())
        await asyncio.wait((receiving, wanted), return_when=asyncio.FIRST_COMPLETED)
        if not receiving.done():
            receiving.cancel()
            more = False
        else:
            message = receiving.result()
            more = message["type"] == "http.request" and message.get("more_body", False)
            held += message.get("body", b"")
        if offset + len(held) > upload.size:
            await to_thread.run_sync(upload.cut, begin, limiter=server.transfers.writers)
            raise HTTPException(413, "There is more than was announced.")
        if held and (len(held) >= _PART or not more):
            await to_thread.run_sync(upload.append, held, offset, limiter=server.transfers.writers)
            offset, held = offset + len(held), bytearray()


async def _finish(server: Server, user: str, upload: Upload) -> None:
    """Take a complete upload into its project; a refused one is deleted, one that the disk refused stays."""
    if upload.taken:
        return
    await to_thread.run_sync(_take_in, server, user, upload, limiter=server.transfers.checkers)


def _take_in(server: Server, user: str, upload: Upload) -> None:
    library = server.library(user)
    try:
        project = library.project(upload.project)
        upload.force_to_disk()
        sha256 = file_sha256(upload.file)
        if upload.sha256 and upload.sha256 != sha256:
            raise FormatError(f"{upload.filename} was damaged on its way. Choose it again.")
        if is_video(upload.file, upload.filename):
            video = take_in_video(project, upload.file, upload.filename, sha256)
            server.uploads.mark_taken(upload)
            server.queue.submit(project, frames_arguments(project, video))
        else:
            take_in_photo(project, upload.file, upload.filename, sha256, server.settings)
            server.uploads.mark_taken(upload)
    except DiskError:
        raise
    except HeritageError:
        if not upload.taken:
            server.uploads.forget(upload)
        raise
    server.feeds.publish(project.folder, "photos")


def _begin(server: Server, user: str, metadata: dict[str, str], size: int) -> Upload:
    """Refuse an upload before its first byte, or begin it."""
    library = server.library(user)
    library.project(metadata.get("project", ""))
    name = photo_name(metadata.get("filename", ""))
    if size == 0:
        raise HTTPException(400, "The file is empty.")
    limit = server.settings.max_video_bytes if is_video_name(name) else server.settings.max_photo_bytes
    if size > limit:
        raise HTTPException(413, f"{name} is larger than {limit / 1e6:,.0f} MB.")
    sha256 = metadata.get("sha256", "")
    if sha256 and not _SHA256.fullmatch(sha256):
        raise HTTPException(400, "The metadata sha256 is not a SHA-256 in small letters.")
    return server.uploads.begin(
        user, library.uploads, project=metadata["project"], filename=name, size=size, sha256=sha256,
        used_bytes=library.used_bytes,
    )  # fmt: skip


def _find(server: Server, user: str, upload_id: str) -> Upload:
    upload = server.uploads.find(user, upload_id)
    if upload is None:
        raise HTTPException(404, "There is no such upload.")
    return upload


def _require_kept(server: Server, user: str, upload: Upload) -> None:
    """Check that the request that held the upload before has not ended it."""
    if _find(server, user, upload.id) is not upload:
        raise ProjectError("There is no such upload.")


def _number(text: str, name: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > _MAX_DIGITS:
        raise HTTPException(400, f"The header {name} must be a number of bytes.")
    return int(text)


def _metadata(text: str) -> dict[str, str]:
    """Return the pairs of ``Upload-Metadata``: names with values in Base64."""
    found = {}
    for pair in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = pair.partition(" ")
        try:
            found[name] = base64.b64decode(value.strip(), validate=True).decode()
        except (binascii.Error, UnicodeDecodeError) as error:
            raise HTTPException(400, "The header Upload-Metadata is not Base64 of UTF-8.") from error
    return found
