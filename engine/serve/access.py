"""Who sends a request, and whether it may: cookies, tokens and protection against requests of other sites."""

from __future__ import annotations

import hmac
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, HTTPException, Request, Response

from .accounts import LOCAL_USER, Accounts
from .connections import Connections
from .feeds import Feeds
from .heavy_work import HeavyWork
from .job_queue import JobQueue
from .library import Library, WebProject
from .settings import ServeSettings
from .streams import Streams
from .transfers import Transfers
from .unfinished import Uploads

_CSRF_HEADER = "x-csrf-token"
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_DAY = 86400
CLAIM = "claim of user"
"""Key of the function in the scope of a request that counts the request for its user."""


@dataclass(frozen=True)
class Server:
    """Objects that the handlers of all requests share."""

    settings: ServeSettings
    accounts: Accounts
    queue: JobQueue
    feeds: Feeds
    uploads: Uploads
    connections: Connections
    work: HeavyWork
    streams: Streams
    transfers: Transfers = field(default_factory=Transfers)

    def library(self, user: str) -> Library:
        """Return the projects of a user."""
        return Library(self.settings, user)


def server_of(request: Request) -> Server:
    """Return the server that handles `request`."""
    server: Server = request.app.state.server
    return server


def session_user(request: Request) -> str | None:
    """Return the user of the cookie, or None."""
    cookie = session_cookie(request)
    return server_of(request).accounts.user_of_session(cookie) if cookie else None


def session_cookie(request: Request) -> str:
    """Return the cookie of this server, or an empty text."""
    return request.cookies.get(server_of(request).accounts.cookie_name, "")


def current_user(request: Request) -> str:
    """Return the user that sends `request`, by a cookie or by ``Authorization: Bearer TOKEN``."""
    user = _sender(request)
    claim = request.scope.get(CLAIM)
    if claim is not None and not claim(user):
        raise HTTPException(429, "Too many requests are being answered for you. Wait until some have ended.")
    return user


def _sender(request: Request) -> str:
    accounts = server_of(request).accounts
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    user = accounts.user_of_token(token.strip()) if scheme.lower() == "bearer" else None
    if user is not None:
        return user
    user = session_user(request)
    if user is None:
        raise HTTPException(401, "Sign in first.")
    if request.method not in _SAFE_METHODS:
        # A page of another site can send our cookie, but cannot read what `csrf_token` returns.
        expected = accounts.csrf_token(session_cookie(request))
        if not hmac.compare_digest(request.headers.get(_CSRF_HEADER, "").encode(), expected.encode()):
            raise HTTPException(403, "The page is out of date. Load it again.")
    return user


def set_session(request: Request, response: Response, user: str) -> str:
    """Give the browser a session of `user`, and return the value of its cookie."""
    server = server_of(request)
    days = server.settings.session_days
    cookie = server.accounts.new_session(user, days)
    response.set_cookie(
        server.accounts.cookie_name,
        cookie,
        max_age=int(days * _DAY),
        httponly=True,
        samesite="strict",
        secure=server.settings.lan,
    )
    return cookie


def local_user(request: Request) -> str | None:
    """Return the user that needs no token: the only one of a server that other computers cannot reach."""
    return None if server_of(request).settings.lan else LOCAL_USER


CurrentUser = Annotated[str, Depends(current_user)]


def current_project(project_id: str, request: Request, user: CurrentUser) -> WebProject:
    """Return the project that a path names, if it is the user's."""
    return server_of(request).library(user).project(project_id)


CurrentProject = Annotated[WebProject, Depends(current_project)]
