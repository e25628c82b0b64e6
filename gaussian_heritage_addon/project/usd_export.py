"""USD files from Blender: by Blender's own OpenUSD where it knows Gaussians, otherwise by the engine's Python."""

from __future__ import annotations

import re
from pathlib import Path

from ...engine.core.errors import EnvironmentProblem
from ...engine.formats import FileFacts, has_openusd, write_usd, write_usd_elsewhere
from ...engine.scene import Gaussians
from ..setup.preferences import current_python

_FIRST_VERSION = (26, 3)
"""First OpenUSD with Gaussians."""


def can_write_usd() -> bool:
    """Return whether USD can be written, here or by the engine's Python."""
    return has_openusd() or _python_with_openusd() is not None


def write_usd_file(path: Path, gaussians: Gaussians, facts: FileFacts) -> None:
    """Write `gaussians` as USD; see `engine.formats.write_usd` for `facts`.

    Raises
    ------
    EnvironmentProblem
        When neither Blender nor the engine has an OpenUSD that knows Gaussians.
    HeritageError
        As `write_usd`.
    """
    if has_openusd():
        write_usd(path, gaussians, facts)
        return
    python = _python_with_openusd()
    if python is None:
        raise EnvironmentProblem(
            f"{path.name} cannot be written, because neither Blender nor the engine has OpenUSD 26.03 or newer. Export "
            "GLB, PLY or SPZ instead, or install requirements/formats.txt into the engine's Python."
        )
    write_usd_elsewhere(python, path, gaussians, facts)


def _python_with_openusd() -> Path | None:
    """Return the engine's Python where it has OpenUSD: panels ask often, so its packages are listed, not started."""
    try:
        python = current_python()
    except EnvironmentProblem:
        return None
    environment = python.parent.parent
    for packages in (environment / "Lib" / "site-packages", *environment.glob("lib/python3*/site-packages")):
        for found in packages.glob("usd_core-*.dist-info"):
            version = tuple(int(number) for number in re.findall(r"\d+", found.name)[:2])
            if version >= _FIRST_VERSION:
                return python
    return None
