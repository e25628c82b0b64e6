"""The application: routes, the page, and the answers to errors."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.middleware.trustedhost import TrustedHostMiddleware
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from .. import __version__
from ..core.errors import DiskError, FormatError, HeritageError, PhotoError, ProjectError, PromptError, SettingsError
from ..core.language import TEXTS
from .access import Server
from .accounts import Accounts
from .api import api_router
from .connections import Connections
from .feeds import Feeds
from .guards import RequestLimits, SecurityHeaders
from .heavy_work import HeavyWork
from .job_queue import JobQueue
from .library import NotFound
from .page_files import PageFiles
from .settings import ServeSettings
from .streams import Streams
from .tidying import tidy_up
from .unfinished import TooManyUploads, Uploads

_LOG = logging.getLogger(__name__)
PAGE = Path(__file__).with_name("page") / "dist"
"""The built page."""
_STATUS: tuple[tuple[type[HeritageError], int], ...] = (
    (NotFound, 404),
    (TooManyUploads, 429),
    (DiskError, 507),
    (ProjectError, 409),
    (PromptError, 422),
    (SettingsError, 422),
    (PhotoError, 415),
    (FormatError, 415),
)
"""HTTP status of each kind of error; the first that fits. Others are 500."""
_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


def create_app(settings: ServeSettings, hosts: list[str], page: Path = PAGE) -> FastAPI:
    """Return the server as an ASGI application.

    Parameters
    ----------
    hosts : list of str
        Names by which clients may address the server. Others are refused: a page of another site could make its own
        name lead here.
    page : Path
        Folder of the built page.
    """
    feeds = Feeds()
    server = Server(
        settings,
        Accounts(settings.data),
        JobQueue(settings.data, feeds, stop_jobs=settings.stop_jobs, scheduler=settings.scheduler),
        feeds,
        Uploads(settings),
        Connections(settings),
        HeavyWork(settings),
        Streams(settings, feeds),
    )

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        server.uploads.load()
        await tidy_up(server)
        server.queue.start()
        tidying = asyncio.create_task(_tidy_up_again(server))
        yield
        tidying.cancel()
        server.queue.stop()

    app = FastAPI(
        title="Gaussian Heritage",
        version=__version__,
        lifespan=lifespan,
        openapi_url="/api/v1/openapi.json",
        # Their pages load scripts from another host.
        docs_url=None,
        redoc_url=None,
    )
    app.state.server = server
    app.include_router(api_router())
    app.mount("/languages", PageFiles(directory=TEXTS))
    app.mount("/", PageFiles(directory=page, html=True))
    app.add_exception_handler(HeritageError, _heritage_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(OSError, _system_error)
    app.add_exception_handler(Exception, _unexpected_error)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=hosts)
    app.add_middleware(RequestLimits, settings=settings, connections=server.connections)
    app.add_middleware(SecurityHeaders, settings=settings)
    return app


async def _tidy_up_again(server: Server) -> None:
    while True:
        await asyncio.sleep(server.settings.tidy_seconds)
        try:
            await tidy_up(server)
        except Exception:
            # What cannot be deleted now is tried again; the log has the error.
            _LOG.exception("old files could not be deleted")


async def _heritage_error(request: Request, error: Exception) -> JSONResponse:
    status = next((status for kind, status in _STATUS if isinstance(error, kind)), 500)
    # Where things are on the server's disk does not concern its clients.
    data = str(request.app.state.server.settings.data)
    return _sentence(status, str(error).replace(data, "the server"))


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    return _sentence(error.status_code, str(error.detail), dict(error.headers or {}))


async def _validation_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    first: dict[str, Any] = dict(error.errors()[0])
    place = ".".join(str(part) for part in first["loc"] if part not in ("body", "query", "path", "header"))
    return _sentence(422, f"{place or 'The request'}: {first['msg']}.")


async def _system_error(request: Request, error: Exception) -> JSONResponse:
    if isinstance(error, OSError) and error.errno in _FULL:
        return _sentence(507, "The disk of the server is full. Ask its owner to make space, then try again.")
    return await _unexpected_error(request, error)


async def _unexpected_error(request: Request, error: Exception) -> JSONResponse:
    _LOG.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return _sentence(500, "The server failed. Its log has the details; try again.")


def _sentence(status: int, detail: str, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"detail": detail}, status, headers)
