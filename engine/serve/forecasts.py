"""How long a reconstruction of a project's photos would take, by preset."""

from __future__ import annotations

import hashlib
import threading

from ..errors import FormatError, ProjectError
from ..files import delete_derived, read_json, write_json
from .engine_call import call_engine
from .library import WebProject
from .settings import ServeSettings

__all__ = ["forecast_of_presets"]

_SCHEMA = {"seconds": {str: [float]}}
_NAME = "forecast-{}.json"
_one_forecast = threading.Lock()


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
    names = project.photo_names()
    if not names:
        raise ProjectError("Upload photos first.")
    sizes = [(name, project.photo(name).stat().st_size) for name in names]
    key = hashlib.sha256(repr((sizes, settings.device)).encode()).hexdigest()[:16]
    file = project.cache / _NAME.format(key)
    with _one_forecast:
        try:
            stored: dict[str, list[float]] = read_json(file, _SCHEMA, advice="Delete it.")["seconds"]
            return stored
        except FormatError:
            pass  # not there, or damaged
        arguments = ["plan", str(project.photos), "--every-preset", f"--device={settings.device}"]
        seconds: dict[str, list[float]] = call_engine(arguments, "forecast")["seconds"]
        project.cache.mkdir(exist_ok=True)
        for old in project.cache.glob(_NAME.format("*")):
            delete_derived(project.cache, old.name)
        write_json(file, {"seconds": seconds})
    return seconds
