"""Photos that options of the command line name: found by `engine.scene.match_names`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import PromptError

if TYPE_CHECKING:
    from ...objects import Point, Prompt


def known_photo(name: str, photos: Iterable[str]) -> str:
    """Return the photo that a typed name means; `name` itself when none fits.

    Raises
    ------
    PromptError
        When several photos fit equally well.
    """
    from ...scene import photos_called

    called = photos_called(name, photos)
    if len(called) > 1:
        raise PromptError(f"{name!r} may be {' or '.join(called[:5])}. Give more of the photo's path.")
    return called[0] if called else name


def points_in_known_photos(points: Sequence[Point], project: Path) -> tuple[Point, ...]:
    """Return clicks with the names of the project's photos in place of those that were typed; see `known_photo`."""
    photos = _photos(project)
    return tuple(replace(point, photo=known_photo(point.photo, photos)) for point in points)


def prompt_in_known_photos(prompt: Prompt, project: Path) -> Prompt:
    """Return a prompt with the names of the project's photos in place of those that were typed; see `known_photo`."""
    from ...objects import ClickPrompt, TextPrompt

    if isinstance(prompt, TextPrompt):
        return prompt
    named = replace(
        prompt,
        photo=known_photo(prompt.photo, _photos(project)),
        excluded=points_in_known_photos(prompt.excluded, project),
    )
    return replace(named, more=points_in_known_photos(named.more, project)) if isinstance(named, ClickPrompt) else named


def _photos(project: Path) -> list[str]:
    from ...scene import read_camera_set

    cameras = read_camera_set(project / "cameras")
    return [*(camera.photo for camera in cameras.cameras), *cameras.unregistered]
