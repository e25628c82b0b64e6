"""A cache of arrays in ``.npz`` files. Each holds the hash of its inputs; a damaged or outdated file is ignored."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DiskError
from .writing import atomic_write

__all__ = ["keep_arrays", "read_kept_arrays"]

_LOG = logging.getLogger(__name__)
_HEADER = "header"


def keep_arrays(path: Path, recipe: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to `path`. A file that cannot be written is only logged, since it can be computed again.

    Parameters
    ----------
    path : Path
    recipe : str
        Hash of everything that the arrays were computed from, see `engine.project_folder.stage_key`.
    arrays : mapping of str to array
    """
    entries: dict[str, Any] = {_HEADER: np.array(json.dumps({"recipe": recipe})), **arrays}
    try:
        with atomic_write(path) as stream:
            np.savez(stream, **entries)
    except DiskError as error:
        _LOG.info("%s is not kept: %s", path.name, error)


def read_kept_arrays(path: Path, recipe: str) -> dict[str, NDArray[Any]] | None:
    """Return the arrays of `path`; None when it is missing, damaged or was made from another `recipe`."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            if json.loads(str(archive[_HEADER]))["recipe"] != recipe:
                return None
            return {name: archive[name] for name in archive.files if name != _HEADER}
    # NumPy raises RuntimeError for a damaged zip header.
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, EOFError, zipfile.BadZipFile):
        return None
