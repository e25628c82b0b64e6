"""Work that takes much memory or time, in threads of its own: the others go on answering."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import HTTPException

from .asking import ask_scene
from .downloads import DownloadFormat, export, export_path
from .forecasts import forecast_of_presets, kept_forecast
from .library import WebProject
from .reports import is_current, make_report
from .settings import ServeSettings
from .small_photos import kept_small_photo, small_photo

_Made = TypeVar("_Made")
_PICTURES = 2
"""Photos that are decoded at a time."""


class HeavyWork:
    """Exports and reports, one at a time, forecasts, answers and small photos. Used by the event loop alone."""

    def __init__(self, settings: ServeSettings) -> None:
        self._settings = settings
        self._exports = CapacityLimiter(1)
        self._forecasts = CapacityLimiter(1)
        self._answers = CapacityLimiter(1)
        self._pictures = CapacityLimiter(_PICTURES)
        self._waiting: Counter[str] = Counter()

    async def exported(
        self, project: WebProject, object_id: str | None, file_format: DownloadFormat, frame: str = "upright"
    ) -> Path:
        """Return the scene (None) or an object as a file; it is made where it is missing or out of date.

        Raises
        ------
        HTTPException
            When the user waits for too many exports and questions.
        HeritageError
            When there is no such object, or it cannot be exported.
        """
        file = await to_thread.run_sync(export_path, project, object_id, file_format, frame)
        if file.exists():
            return file
        return await self._made(project.user, lambda: export(project, object_id, file_format, frame), self._exports)

    async def report(self, project: WebProject, *, is_busy: bool) -> None:
        """Make the report of a project anew where the objects or the title changed after it.

        Parameters
        ----------
        is_busy : bool
            Whether a job works on the project, which then may not be changed: the report stays that from before.

        Raises
        ------
        HTTPException
            When the user waits for too many exports and questions.
        HeritageError
            When there is none yet, or it cannot be made.
        """
        if not await to_thread.run_sync(is_current, project) and not is_busy:
            await self._made(project.user, lambda: make_report(project), self._exports)

    async def forecast(self, project: WebProject) -> dict[str, list[float]]:
        """Return `engine.serve.forecasts.forecast_of_presets`.

        Raises
        ------
        HTTPException
            When the user waits for too many exports, questions and forecasts.
        HeritageError
            When there are no photos, or they cannot be used.
        """
        kept = await to_thread.run_sync(kept_forecast, project, self._settings)
        if kept is not None:
            return kept
        return await self._made(project.user, lambda: forecast_of_presets(project, self._settings), self._forecasts)

    async def answers(self, project: WebProject, words: str) -> dict[str, Any]:
        """Return `engine.serve.asking.ask_scene`.

        Raises
        ------
        HTTPException
            When the user waits for too many exports and questions.
        HeritageError
            When nothing is found, or the scene is not being trained.
        """
        return await self._made(project.user, lambda: ask_scene(project, words), self._answers)

    async def small_photo(self, photo: Path, cache: Path, side: int) -> Path:
        """Return `engine.serve.small_photos.small_photo`."""
        kept = await to_thread.run_sync(kept_small_photo, photo, cache, side)
        if kept is not None:
            return kept
        return await self.picture(lambda: small_photo(photo, cache, side))

    async def picture(self, make: Callable[[], Path]) -> Path:
        """Return the file of `make`, which decodes a photo."""
        return await to_thread.run_sync(make, limiter=self._pictures)

    async def _made(self, user: str, make: Callable[[], _Made], limiter: CapacityLimiter) -> _Made:
        if self._waiting[user] >= self._settings.max_user_exports:
            raise HTTPException(
                429, f"{self._waiting[user]} of your exports and questions are under way. Try again later."
            )
        self._waiting[user] += 1
        try:
            return await to_thread.run_sync(make, limiter=limiter)
        finally:
            self._waiting[user] -= 1
            if not self._waiting[user]:
                del self._waiting[user]
