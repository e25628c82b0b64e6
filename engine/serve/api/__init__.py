"""The API under ``/api/v1``: one module for each kind of resource."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from . import jobs, objects, photos, projects, sessions, trash, uploads, views

_STATUS = {
    400: "The request makes no sense.",
    401: "Nobody is signed in.",
    403: "A page sent no token for changing requests, or the owner of the server does not allow it.",
    404: "It does not exist, or belongs to another user.",
    408: "The request did not arrive in time.",
    409: "The state of the project does not allow it.",
    412: "The upload is of another version of the tus protocol.",
    413: "It is too large.",
    415: "It is not what it should be.",
    422: "A value is not allowed.",
    429: "There are too many.",
    500: "The server failed.",
    507: "The disk, or the user's share of it, is full.",
}


_SENTENCE = {"type": "object", "properties": {"detail": {"type": "string"}}, "required": ["detail"]}
"""Schema of a problem, a sentence for the user. A model would be built again for each route and status: 0.2 seconds."""


def api_router() -> APIRouter:
    """Return all routes."""
    responses: dict[int | str, dict[str, Any]] = {
        status: {"description": text, "content": {"application/json": {"schema": _SENTENCE}}}
        for status, text in _STATUS.items()
    }
    router = APIRouter(prefix="/api/v1", responses=responses)
    for module in (sessions, projects, photos, trash, jobs, views, objects, uploads):
        router.include_router(module.router)
    return router
