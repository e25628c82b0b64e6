"""Who sends a request, and whether it may: cookies, tokens and protection against requests of other sites."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, HTTPException, Request, Response

from .accounts import LOCAL_USER, Accounts
from .feeds import Feeds
from .job_queue import JobQueue
from .library import Library, WebProject
from .settings import ServeSettings

__all__ = ["COOKIE", "CurrentProject", "CurrentUser", "Server", "current_user", "server_of", "set_session"]

COOKIE = "session"
_CSRF_HEADER = "x-csrf-token"
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_DAY = 86400


@dataclass(frozen=True)
class Server:
    """What the handlers of all requests share."""

    settings: ServeSettings
    accounts: Accounts
    queue: JobQueue
    feeds: Feeds

    def library(self, user: str) -> Library:
        """Return the projects of a user."""
        return Library(self.settings, user)


def server_of(request: Request) -> Server:
    """Return the server that handles `request`."""
    server: Server = request.app.state.server
    return server


def session_user(request: Request) -> str | None:
    """Return the user of the cookie, or None."""
    cookie = request.cookies.get(COOKIE)
    return None if cookie is None else server_of(request).accounts.user_of_session(cookie)


def current_user(request: Request) -> str:
    """Return the user that sends `request`, by a cookie or by ``Authorization: Bearer TOKEN``."""
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
        expected = accounts.csrf_token(request.cookies[COOKIE])
        if not hmac.compare_digest(request.headers.get(_CSRF_HEADER, "").encode(), expected.encode()):
            raise HTTPException(403, "The page is out of date. Load it again.")
    return user


def set_session(request: Request, response: Response, user: str) -> str:
    """Give the browser a session of `user`, and return the value of its cookie."""
    server = server_of(request)
    days = server.settings.session_days
    cookie = server.accounts.new_session(user, days)
    response.set_cookie(
        COOKIE, cookie, max_age=int(days * _DAY), httponly=True, samesite="strict", secure=server.settings.lan
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
