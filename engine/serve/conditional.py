"""Files that a browser may keep: it asks whether they changed, and they are sent again only then."""

from __future__ import annotations

from pathlib import Path

from fastapi import Request, Response
from fastapi.responses import FileResponse

_KEPT = {"Cache-Control": "private, no-cache"}


def file_answer(request: Request, file: Path, media_type: str) -> Response:
    """Return `file`, or 304 without a body where the browser has it already."""
    status = file.stat()
    # Exports and small photos are replaced as a whole, so time and size tell a new one.
    tag = f'"{status.st_mtime_ns:x}-{status.st_size:x}"'
    headers = {**_KEPT, "ETag": tag}
    known = [one.strip().removeprefix("W/") for one in request.headers.get("if-none-match", "").split(",")]
    if tag in known:
        return Response(status_code=304, headers=headers)
    return FileResponse(file, media_type=media_type, headers=headers)
