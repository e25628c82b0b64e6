"""Arrays that can be made anew, kept on disk with the recipe they were made by: ``.npz`` of which a damaged or outdated
one does not count, and which a disk that refuses only costs time."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DiskError
from .project_folder import atomic_write

__all__ = ["keep_arrays", "read_kept_arrays"]

_LOG = logging.getLogger(__name__)
_HEADER = "header"


def keep_arrays(path: Path, recipe: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to `path`; only logged when the disk refuses.

    Parameters
    ----------
    path : Path
    recipe : str
        Of everything that the arrays were made from, as by `engine.project_folder.stage_key`.
    arrays : mapping of str to array
    """
    entries: dict[str, Any] = {_HEADER: np.array(json.dumps({"recipe": recipe})), **arrays}
    try:
        with atomic_write(path) as stream:
            np.savez(stream, **entries)
    except DiskError as error:
        _LOG.info("%s is not kept: %s", path.name, error)


def read_kept_arrays(path: Path, recipe: str) -> dict[str, NDArray[Any]] | None:
    """Return the arrays of `path`; None unless it is there, whole and of `recipe`."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            if json.loads(str(archive[_HEADER]))["recipe"] != recipe:
                return None
            return {name: archive[name] for name in archive.files if name != _HEADER}
    # A broken header of a zip file ends in RuntimeError.
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, EOFError, zipfile.BadZipFile):
        return None
