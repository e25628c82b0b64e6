"""The origin of results: versions, commit of the code, machine and time, as stages and objects record them."""

from __future__ import annotations

import functools
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from .. import __version__
from ..core.files import Schema, optional
from ..core.system import CODE_ROOT, describe_system, run_text, usable_cores

RUN: Schema = {
    "finished": str,
    "software": {str: str},
    "commit": (str, None),
    "changed": (bool, None),
    "machine": str,
    "settings": optional(dict),
    "seed": optional((int, None)),
}
"""The schema of the results of `describe_run` in stored files."""

_PACKAGES = (
    "torch",
    "numpy",
    "numba",
    "pycolmap",
    "onnxruntime",
    "opencv-contrib-python-headless",
    "scipy",
    "Pillow",
    "wgpu",
)
_GIT_SECONDS = 10.0


def describe_run(settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what a result records of the run that made it.

    Parameters
    ----------
    settings : mapping, optional
        Parameters of the step, JSON values; a ``seed`` among them is recorded on its own too.

    Returns
    -------
    dict
        ``finished`` (ISO 8601, UTC), ``software`` (versions by name), ``commit`` and ``changed`` (see `code_version`),
        ``machine``, and, where `settings` are given, ``settings`` and ``seed`` (None where the step draws nothing).
    """
    commit, changed = code_version()
    run: dict[str, Any] = {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": software_versions(),
        "commit": commit,
        "changed": changed,
        "machine": f"{describe_system()}, {len(usable_cores())} cores",
    }
    if settings is not None:
        run |= {"settings": dict(settings), "seed": settings.get("seed")}
    return run


@functools.cache
def software_versions() -> dict[str, str]:
    """Return the versions of the engine, Python and the packages that results depend on, by name."""
    versions = {"gaussian heritage": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name.lower()] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


@functools.cache
def code_version() -> tuple[str | None, bool | None]:
    """Return the commit of the code, and whether files of it were changed since.

    Both are None where the code is no checkout of git, as in the installed extension: there the version of the engine
    in `software_versions` names the code.
    """
    # Without a checkout, git is not started: on a Mac without developer tools, a dialog would ask to install it.
    commit = _git("rev-parse", "HEAD") if (CODE_ROOT / ".git").exists() else None
    if commit is None or _git("ls-files", "--error-unmatch", "engine/project/provenance.py") is None:
        return None, None
    return commit, _git("status", "--porcelain", "--untracked-files=no", "--", "engine") != ""


def _git(*words: str) -> str | None:
    """Return the output of git in the folder of the code; None when it fails or there is no git."""
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}
    try:
        done = run_text(["git", *words], folder=CODE_ROOT, environment=environment, timeout=_GIT_SECONDS)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
