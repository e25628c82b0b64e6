"""The files of the page, compressed and kept by browsers until they change."""

from __future__ import annotations

import functools
import gzip
from pathlib import Path
from typing import Any

from fastapi import Response
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import Headers

from ..core.files import read_bytes

_MAX_BYTES = 1 << 25
_COMPRESSED = (".js", ".css", ".html", ".json", ".txt")


class PageFiles(StaticFiles):
    """Serves a folder. A browser asks each time whether a file changed, and gets it compressed if it did."""

    async def get_response(self, path: str, scope: Any) -> Response:
        """Return the answer to a request for `path`."""
        response = await super().get_response(path, scope)
        response.headers["Cache-Control"] = "no-cache"
        if not isinstance(response, FileResponse) or not str(response.path).endswith(_COMPRESSED):
            return response
        response.headers["Vary"] = "Accept-Encoding"
        accepted = Headers(scope=scope)
        if "gzip" not in accepted.get("accept-encoding", "") or "range" in accepted or scope["method"] != "GET":
            return response
        file = Path(response.path)
        # The tag is of the file and not of its compressed form, hence weak.
        headers = {
            "ETag": f"W/{response.headers['etag']}",
            "Last-Modified": response.headers["last-modified"],
            "Cache-Control": "no-cache",
            "Content-Encoding": "gzip",
            "Vary": "Accept-Encoding",
        }
        body = _compressed(file, file.stat().st_mtime_ns)
        return Response(body, response.status_code, headers, media_type=response.media_type)


@functools.lru_cache(maxsize=16)
def _compressed(file: Path, changed: int) -> bytes:
    """Return a file with gzip; it is compressed once for all requests."""
    return gzip.compress(read_bytes(file, max_bytes=_MAX_BYTES, advice="Build the page again."), mtime=0)
