"""Setting up the engine from Blender: its state, what will be installed, and the commands. Does not import bpy."""

from __future__ import annotations

from pathlib import Path

from ...engine.core.errors import EnvironmentProblem
from ...engine.core.system import unsupported
from ...engine.install.environment import CONTENTS, EngineEnvironment, default_build, default_folder, sizes
from .model_files import list_models

_MODULE = "engine.install.environment"
_OFFLINE = (
    "Blender may not use the network. Allow Online Access in Preferences > System, or choose an Offline Bundle in "
    "Preferences > Add-ons > Gaussian Heritage."
)


def installed_engine() -> EngineEnvironment:
    """Return the engine that is set up from Blender, which need not exist yet."""
    return EngineEnvironment(default_folder())


def describe(build: str, bundle: str) -> list[str]:
    """Return what the user should know before the engine is set up: size, place and licences, a line each.

    Parameters
    ----------
    build : {"auto", "cpu", "cuda"}
        Build of torch.
    bundle : str
        Path of the offline bundle; empty to download.
    """
    build = default_build() if build == "auto" else build
    lines = [f"From: {bundle}" if bundle else f"Size: {sizes(build)}"]
    lines.append(f"Place: {installed_engine().folder}")
    if build == "cuda":
        lines.append("With PyTorch for NVIDIA graphics cards. Training on a graphics card does not need it.")
    lines += [f"{part.names}: {part.licence}" for part in CONTENTS]
    return lines + [f"{model.name}: {terms}" for model in list_models() if not model.optional for terms in model.terms]


def install_command(python: str, preferred: str, build: str, bundle: str, *, online: bool) -> list[str]:
    """Return the command line that sets up, repairs or updates the engine.

    Parameters
    ----------
    python : str
        Blender's own Python, which runs the installation, and is tried for the engine first.
    preferred : str
        Python that the user named for the engine; empty for none.
    build : {"auto", "cpu", "cuda"}
        Build of torch.
    bundle : str
        Path of an offline bundle; empty to download.
    online : bool
        Whether Blender may use the network (*Allow Online Access*).

    Raises
    ------
    EnvironmentProblem
        When the engine cannot run on this computer, a path does not exist, or the network is needed and not allowed.
    """
    if problem := unsupported():
        raise EnvironmentProblem(problem)
    for what, path in (("Python", preferred), ("offline bundle", bundle)):
        if path and not Path(path).is_file():
            raise EnvironmentProblem(f"The {what} {path} does not exist. Choose another one in the preferences.")
    if not bundle and not online:
        raise EnvironmentProblem(_OFFLINE)
    command = [python, "-m", _MODULE, "install", "--folder", str(installed_engine().folder), "--torch", build]
    for one in [preferred, python] if preferred else [python]:
        command += ["--python", one]
    command += ["--bundle", bundle] if bundle else []
    return [*command, "--events"]


def remove_command(python: str) -> list[str]:
    """Return the command line that deletes the engine."""
    return [python, "-m", _MODULE, "remove", "--folder", str(installed_engine().folder), "--events"]
