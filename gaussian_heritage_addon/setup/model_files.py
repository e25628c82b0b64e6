"""The engine's models as the preferences show them: files, licences, states and download. Does not import bpy."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ...engine.core.errors import EnvironmentProblem, FormatError, ModelFileError
from ...engine.core.files import parse_json
from ...engine.install.models.catalogue import CATALOGUE, MODELS, ModelFile

States = dict[str, str]
"""State of each file by its name: its path, or ``!`` followed by the engine's error message."""
State = Literal["AVAILABLE", "PROBLEM", "UNKNOWN"]


@dataclass(frozen=True)
class Model:
    """A model and its files.

    Attributes
    ----------
    name : str
        Argument of ``models fetch``.
    purpose : str
        A sentence for users.
    files : tuple of ModelFile
    """

    name: str
    purpose: str
    files: tuple[ModelFile, ...]

    @property
    def optional(self) -> bool:
        """Whether the engine works without this model."""
        return all(file.optional for file in self.files)

    @property
    def title(self) -> str:
        """Name and size, for display."""
        return f"{self.name} ({megabytes(self)}{', optional' if self.optional else ''})"

    @property
    def terms(self) -> tuple[str, ...]:
        """Licence and permitted users; files with the same terms share a line."""
        lines: dict[tuple[str, str], list[str]] = {}
        for file in self.files:
            lines.setdefault((file.licence, file.who_may_use), []).append(file.name)
        prefixes = {terms: "" if len(lines) == 1 else f"{', '.join(names)}: " for terms, names in lines.items()}
        return tuple(f"{prefixes[licence, users]}{licence}. Who may use it: {users}." for licence, users in lines)

    @property
    def sources(self) -> tuple[str, ...]:
        """Source of each file, and what its integrity is checked against."""
        return tuple(dict.fromkeys(f"{file.source}; {file.pin}" for file in self.files))

    def state(self, states: States) -> tuple[State, str]:
        """Return whether the model can be used, and the engine's error message if not."""
        known = [states.get(file.name, "") for file in self.files]
        problems = [state[1:] for state in known if state.startswith("!")]
        if problems:
            return "PROBLEM", problems[0]
        return ("AVAILABLE", "") if all(known) else ("UNKNOWN", "")


def megabytes(model: Model) -> str:
    """Return the size of all files of a model as text."""
    sizes = [file.about_bytes for file in model.files]
    about = "" if all(file.size for file in model.files) else "about "
    return f"{about}{sum(sizes) / 1e6:.0f} MB"


def list_models() -> tuple[Model, ...]:
    """Return the models of the catalogue, required ones first."""
    models = [Model(name, one.purpose, tuple(CATALOGUE[file] for file in one.files)) for name, one in MODELS.items()]
    return tuple(sorted(models, key=lambda model: model.optional))


def find_model(name: str) -> Model:
    """Return the model called `name`.

    Raises
    ------
    ModelFileError
        When there is no such model.
    """
    for model in list_models():
        if model.name == name:
            return model
    raise ModelFileError(f"There is no model called {name!r}. Known: {', '.join(m.name for m in list_models())}.")


def fetch_arguments(name: str, folder: str, *, online: bool) -> list[str]:
    """Return the engine's arguments that fetch a model.

    Parameters
    ----------
    folder : str
        Folder with model files, used instead of the network; empty to download.
    online : bool
        Whether Blender may use the network (*Allow Online Access*).

    Raises
    ------
    ModelFileError
        When there is no such model or folder.
    EnvironmentProblem
        When the model must be downloaded and Blender may not use the network.
    """
    require_source(name, folder, online=online)
    return ["models", "fetch", name, *(["--from", folder] if folder else [])]


def require_source(name: str, folder: str, *, online: bool) -> None:
    """Raise an error where a model cannot be fetched; parameters and errors as of `fetch_arguments`."""
    find_model(name)
    if folder:
        if not Path(folder).is_dir():
            raise ModelFileError(f"There is no folder {folder}. Choose the one that contains the model files.")
    elif not online:
        raise EnvironmentProblem(
            "Blender may not use the network. Allow Online Access in Preferences > System, or choose a folder with "
            "the model files as Offline Folder."
        )


def states_of(outputs: Mapping[str, Any]) -> States:
    """Return the states in the outputs of ``models list``, ``fetch`` or ``verify``."""
    models, problems = outputs.get("models"), outputs.get("problems")
    if not isinstance(models, dict):
        return {}
    broken = problems if isinstance(problems, list) else []
    return {name: f"!{state}" if name in broken else str(state) for name, state in models.items()}


def problems_of(outputs: Mapping[str, Any]) -> list[str]:
    """Return the error messages in the outputs of ``models verify``."""
    return [state[1:] for state in states_of(outputs).values() if state.startswith("!")]


def stored_states(text: str) -> States:
    """Return the states that `merge_states` stored in the preferences; none where they cannot be read."""
    try:
        states: States = parse_json(text or "{}", {str: str}, source="The states of the models", advice="")
    except FormatError:
        return {}
    return states


def merge_states(stored: str, new: States) -> str:
    """Return the JSON text `stored`, updated with the states `new`."""
    return json.dumps({**stored_states(stored), **new})
