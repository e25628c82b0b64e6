"""Work that takes much memory or time, in threads of its own: the others go on answering."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

from anyio import CapacityLimiter, to_thread
from fastapi import HTTPException

from .downloads import export, export_path
from .library import WebProject
from .small_photos import kept_small_photo, small_photo

__all__ = ["HeavyWork"]

_PICTURES = 2
"""Photos that are decoded at a time."""


class HeavyWork:
    """Exports, one at a time, and small copies of photos. Used by the event loop alone.

    Parameters
    ----------
    max_user_exports : int
        Exports of a user that may wait.
    """

    def __init__(self, max_user_exports: int) -> None:
        self._max_user_exports = max_user_exports
        self._exports = CapacityLimiter(1)
        self._pictures = CapacityLimiter(_PICTURES)
        self._waiting: Counter[str] = Counter()

    async def exported(
        self, project: WebProject, object_id: str | None, file_format: str, frame: str = "upright"
    ) -> Path:
        """Return the scene (None) or an object as a file; it is made where it is missing or out of date.

        Raises
        ------
        HTTPException
            When the user waits for too many exports.
        HeritageError
            When there is no such object, or it cannot be exported.
        """
        file = await to_thread.run_sync(export_path, project, object_id, file_format, frame)
        if file.exists():
            return file
        user = project.user
        if self._waiting[user] >= self._max_user_exports:
            raise HTTPException(429, f"{self._waiting[user]} of your exports are being made. Try again later.")
        self._waiting[user] += 1
        try:
            make: Callable[[], Path] = lambda: export(project, object_id, file_format, frame)  # noqa: E731
            return await to_thread.run_sync(make, limiter=self._exports)
        finally:
            self._waiting[user] -= 1
            if not self._waiting[user]:
                del self._waiting[user]

    async def small_photo(self, photo: Path, cache: Path, side: int) -> Path:
        """Return `engine.serve.small_photos.small_photo`."""
        kept = await to_thread.run_sync(kept_small_photo, photo, cache, side)
        if kept is not None:
            return kept
        return await to_thread.run_sync(small_photo, photo, cache, side, limiter=self._pictures)
