"""How long a reconstruction of a project's photos would take, by preset."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ..core.errors import FormatError, ProjectError
from ..core.files import bytes_of, delete_derived, read_json, write_json
from .engine_call import call_engine
from .library import WebProject
from .settings import ServeSettings

_SCHEMA = {"seconds": {str: [float]}}
_NAME = "forecast-{}.json"


def forecast_of_presets(project: WebProject, settings: ServeSettings) -> dict[str, list[float]]:
    """Return low, expected and high wall seconds of a reconstruction by preset; 8 of 10 runs lie in between.

    It is stored until the photos change.

    Raises
    ------
    ProjectError
        When there are no photos.
    HeritageError
        When the photos cannot be used, or the device of the server cannot.
    """
    kept = kept_forecast(project, settings)
    if kept is not None:
        return kept
    file = _file(project, settings)
    answer = call_engine(["plan", str(project.photos), "--every-preset", f"--device={settings.device}"], "forecast")
    seconds: dict[str, list[float]] = {one["name"]: one["forecast"]["seconds"] for one in answer["presets"]}
    project.cache.mkdir(exist_ok=True)
    for old in project.cache.glob(_NAME.format("*")):
        delete_derived(project.cache, old.name)
    write_json(file, {"seconds": seconds})
    return seconds


def kept_forecast(project: WebProject, settings: ServeSettings) -> dict[str, list[float]] | None:
    """Return the forecast of `forecast_of_presets` where it has been made already.

    Raises
    ------
    ProjectError
        When there are no photos.
    """
    try:
        stored: dict[str, list[float]] = read_json(_file(project, settings), _SCHEMA, advice="Delete it.")["seconds"]
    except FormatError:
        return None  # not there, or damaged
    return stored


def _file(project: WebProject, settings: ServeSettings) -> Path:
    names = project.photo_names()
    if not names:
        raise ProjectError("Upload photos first.")
    sizes = [(name, bytes_of(project.photos / name)) for name in names]
    key = hashlib.sha256(repr((sizes, settings.device)).encode()).hexdigest()[:16]
    return project.cache / _NAME.format(key)
