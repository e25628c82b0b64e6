"""The engine's weight files as the preferences show them: what each model is, who may use it, what to ask. No bpy."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..engine.errors import EnvironmentProblem, ModelFileError
from ..engine.models.entries import CATALOGUE, GROUPS, ModelFile

__all__ = ["Model", "States", "fetch_arguments", "find_model", "list_models", "merged_states", "states_from"]

States = dict[str, str]
"""By file: its path, or the engine's sentence about what is wrong, told apart by a leading ``!``."""
State = Literal["THERE", "PROBLEM", "UNKNOWN"]


@dataclass(frozen=True)
class Model:
    """A model and the files it needs together.

    Attributes
    ----------
    name : str
        As ``models fetch`` knows it.
    files : tuple of ModelFile
    """

    name: str
    files: tuple[ModelFile, ...]

    @property
    def optional(self) -> bool:
        """Whether the engine works without it."""
        return all(file.optional for file in self.files)

    @property
    def title(self) -> str:
        """Its name and size for a person."""
        sizes = [file.size or file.about or 0 for file in self.files]
        about = "" if all(file.size for file in self.files) else "about "
        return f"{self.name} ({about}{sum(sizes) / 1e6:.0f} MB{', optional' if self.optional else ''})"

    @property
    def terms(self) -> tuple[str, ...]:
        """Licence and who may use it, for each file or several at once."""
        lines: dict[tuple[str, str], list[str]] = {}
        for file in self.files:
            lines.setdefault((file.licence, file.who_may_use), []).append(file.name)
        whose = {terms: "" if len(lines) == 1 else f"{', '.join(names)}: " for terms, names in lines.items()}
        return tuple(f"{whose[licence, users]}{licence}. Who may use it: {users}." for licence, users in lines)

    @property
    def sources(self) -> tuple[str, ...]:
        """Where its files come from, and what keeps them from being exchanged."""
        return tuple(dict.fromkeys(f"{file.source}; {file.pin}" for file in self.files))

    def state(self, states: States) -> tuple[State, str]:
        """Return whether it can be used, and the engine's sentence when not."""
        known = [states.get(file.name, "") for file in self.files]
        problems = [state[1:] for state in known if state.startswith("!")]
        if problems:
            return "PROBLEM", problems[0]
        return ("THERE", "") if all(known) else ("UNKNOWN", "")


def list_models() -> tuple[Model, ...]:
    """Return the models of the catalogue, those the engine cannot do without first."""
    models = [Model(name, tuple(CATALOGUE[file] for file in files)) for name, files in GROUPS.items()]
    return tuple(sorted(models, key=lambda model: model.optional))


def find_model(name: str) -> Model:
    """Return the model called `name`.

    Raises
    ------
    ModelFileError
        When there is none.
    """
    for model in list_models():
        if model.name == name:
            return model
    raise ModelFileError(f"There is no model called {name!r}. Known: {', '.join(m.name for m in list_models())}.")


def fetch_arguments(name: str, folder: str, *, online: bool) -> list[str]:
    """Return the engine's arguments that fetch a model.

    Parameters
    ----------
    name : str
    folder : str
        With the files a colleague downloaded, taken instead of the network; empty for none.
    online : bool
        Blender's own permission to use the network.

    Raises
    ------
    ModelFileError
        When there is no such model or folder.
    EnvironmentProblem
        When only the network could give it and Blender may not use it.
    """
    find_model(name)
    if folder:
        if not Path(folder).is_dir():
            raise ModelFileError(f"There is no folder {folder}. Choose the one that holds the model files.")
        return ["models", "fetch", name, "--from", folder]
    if not online:
        raise EnvironmentProblem(
            "Blender may not use the network. Allow Online Access in Preferences > System, or choose a folder with "
            "the model files as Offline Folder."
        )
    return ["models", "fetch", name]


def states_from(outputs: Mapping[str, Any]) -> States:
    """Return the states in the outputs of ``models list``, ``fetch`` or ``verify``."""
    problems = set(outputs.get("problems", ()))
    return {name: f"!{said}" if name in problems else str(said) for name, said in outputs.get("models", {}).items()}


def merged_states(stored: str, new: States) -> str:
    """Return the JSON text `stored` with the states `new`."""
    return json.dumps({**(json.loads(stored) if stored else {}), **new})
