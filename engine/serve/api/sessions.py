"""Signing in and out, and what the page has to know before anything else."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, HTTPException, Request, Response
from pydantic import BaseModel, Field

from ...cameras.settings import FEWEST_PHOTOS
from ...core.language import languages
from ...core.stage_names import STAGE_NAMES
from ...photos.settings import PHOTO_SUFFIXES, VIDEO_SUFFIXES
from ...training.settings import DEFAULT_PRESET, LIGHT_DESCRIPTION, LIGHT_LABEL, OFFERED_PRESETS
from ..access import CurrentUser, local_user, server_of, session_cookie, session_user, set_session
from ..downloads import DOWNLOADS

router = APIRouter(prefix="/session", tags=["session"])


class Token(BaseModel):
    """The token of a user, as ``serve --add-user`` printed it."""

    token: str = Field(max_length=200)


@router.get("")
def read_session(request: Request, response: Response) -> dict[str, Any]:
    """Return the signed-in user, the token for changing requests, the limits, and what there is to choose."""
    user, cookie = session_user(request), session_cookie(request)
    if user is None and (user := local_user(request)) is not None:
        cookie = set_session(request, response, user)
    return _description(request, user, cookie)


@router.post("")
def sign_in(token: Token, request: Request, response: Response) -> dict[str, Any]:
    """Sign in with a token, or with the code of an address that the server showed at its start, which serves once."""
    accounts = server_of(request).accounts
    user = accounts.user_of_token(token.token) or accounts.user_of_code(token.token)
    if user is None:
        raise HTTPException(401, "This token is not known. Ask the owner of the server for a new one.")
    return _description(request, user, set_session(request, response, user))


@router.delete("", status_code=204)
def sign_out(user: CurrentUser, request: Request, response: Response) -> None:
    """End the session, here and for whoever has a copy of its cookie."""
    accounts = server_of(request).accounts
    accounts.end_session(session_cookie(request))
    response.delete_cookie(accounts.cookie_name)


def _description(request: Request, user: str | None, cookie: str) -> dict[str, Any]:
    server = server_of(request)
    limits = {
        "photo_bytes": server.settings.max_photo_bytes,
        "project_photos": server.settings.max_photos,
        "fewest_photos": FEWEST_PHOTOS,
        "photo_types": list(PHOTO_SUFFIXES),
        "video_types": list(VIDEO_SUFFIXES),
    }
    return {
        "user": user,
        "csrf": "" if user is None else server.accounts.csrf_token(cookie),
        "limits": limits,
        "languages": {one.code: one.name for one in languages()},
        "stages": STAGE_NAMES,
        "presets": [{"name": one.name, "label": one.label, "description": one.description} for one in OFFERED_PRESETS],
        "default_preset": DEFAULT_PRESET,
        "light": {"label": LIGHT_LABEL, "description": LIGHT_DESCRIPTION},
        "formats": [{"name": one.name, "label": one.label, "of_scenes": one.write_mesh is None} for one in DOWNLOADS],
    }
