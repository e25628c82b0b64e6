"""The API under ``/api/v1``: one module for each kind of resource."""

from __future__ import annotations

from fastapi import APIRouter

from ..settings import ServeSettings
from . import jobs, objects, photos, projects, sessions, views
from .uploads import upload_router

__all__ = ["api_router"]


def api_router(settings: ServeSettings) -> APIRouter:
    """Return all routes."""
    router = APIRouter(prefix="/api/v1")
    for module in (sessions, projects, photos, jobs, views, objects):
        router.include_router(module.router)
    router.include_router(upload_router(settings))
    return router
