"""Checks of this machine: packages, models, GPU, disk and memory."""

from __future__ import annotations

import importlib
import importlib.metadata
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .. import __version__
from ..core.errors import EnvironmentProblem, HeritageError
from ..core.system import describe_system, total_memory, usable_cores

_REQUIRED_PACKAGES = {
    "numpy": "numpy",
    "torch": "torch",
    "pycolmap": "pycolmap",
    "onnxruntime": "onnxruntime",
    "cv2": "opencv-contrib-python-headless",
    "numba": "numba",
    "scipy": "scipy",
    "PIL": "pillow",
    "tokenizers": "tokenizers",
    "matplotlib": "matplotlib",
    "tqdm": "tqdm",
    "platformdirs": "platformdirs",
}
_MIN_FREE_GB = 2.0


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Attributes
    ----------
    name : str
    ok : bool
    required : bool
        Whether the engine cannot run without it.
    detail : str
        What was found, or what to do about it.
    """

    name: str
    ok: bool
    required: bool
    detail: str


def missing_package(name: str | None) -> EnvironmentProblem:
    """Return the error for a package that this Python does not have."""
    return EnvironmentProblem(
        f"This Python ({sys.executable}) has no package {name!r}. "
        "Press Set Up Engine in Blender, or run `make setup` and use .venv/engine."
    )


def examine() -> list[Check]:
    """Return the results of all checks, in the order in which they are shown."""
    checks = [Check("Gaussian Heritage", True, False, __version__), _python()]
    checks += [_package(module, distribution) for module, distribution in _REQUIRED_PACKAGES.items()]
    if all(check.ok for check in checks):
        checks += [_gpu(), _encoding(), *_models()]
    checks += [_heic(), _disk(), _machine()]
    return checks


def _python() -> Check:
    version = platform.python_version()
    ok = sys.version_info >= (3, 11)
    return Check("Python", ok, True, version if ok else f"{version}; 3.11 or newer is needed")


def _package(module: str, distribution: str) -> Check:
    try:
        importlib.import_module(module)
        return Check(distribution, True, True, importlib.metadata.version(distribution))
    except ImportError as error:
        return Check(distribution, False, True, f"missing ({error}); set up the engine again")
    # A damaged package may raise anything when it is imported.
    except Exception as error:
        return Check(distribution, False, True, f"damaged ({type(error).__name__}: {error}); install it again")


def _gpu() -> Check:
    from ..rasterizer import look_for_card

    device = look_for_card(always_test=True)
    is_used = device.backend == "gpu"
    uses = "`render` and training use it" if is_used else "pictures and training use the CPU"
    return Check("graphics card", is_used, False, f"{device.found}; {uses}")


def _encoding() -> Check:
    from ..masks import card_encodes

    usable, found = card_encodes()
    return Check("segments", usable, False, found.rstrip("."))


def _models() -> list[Check]:
    from ..install.models import CATALOGUE, locate

    def check(name: str, find: Callable[[str], Path]) -> Check:
        try:
            return Check(f"model {name}", True, True, f"{find(name).stat().st_size / 1e6:.1f} MB")
        except (HeritageError, OSError) as error:
            return Check(f"model {name}", False, True, str(error))

    return [check(name, locate) for name, model in CATALOGUE.items() if not model.optional]


def _heic() -> Check:
    try:
        importlib.import_module("pillow_heif")
    except Exception:  # missing or damaged
        return Check("HEIC photos", False, False, "not readable; set up the engine again")
    try:
        importlib.import_module("av")
    except Exception:
        return Check("HEIC photos", False, False, "readable, but slowly; set up the engine again")
    return Check("HEIC photos", True, False, "readable")


def _disk() -> Check:
    try:
        free = shutil.disk_usage(Path.cwd()).free / 1e9
    except OSError as error:  # the folder was deleted, or belongs to another user
        return Check("disk space here", False, False, f"unknown ({error.strerror})")
    return Check("disk space here", free >= _MIN_FREE_GB, False, f"{free:.1f} GB free")


def _machine() -> Check:
    detail = f"{len(usable_cores())} cores, {describe_system()}"
    memory = total_memory()
    if memory is not None:
        detail += f", {memory / 1e9:.0f} GB memory"
    return Check("machine", True, False, detail)
