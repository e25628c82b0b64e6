"""A cache of arrays in ``.npz`` files. Each holds the hash of its inputs; a damaged or outdated file is ignored."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DiskError, FormatError
from .arrays import ArraySpec, read_arrays
from .reading import parse_json
from .writing import atomic_write

_LOG = logging.getLogger(__name__)
_HEADER = "header"
_TEXT = ArraySpec("str", ())
_ADVICE = "It is computed again."


def keep_arrays(path: Path, recipe: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to `path`. A file that cannot be written is only logged, since it can be computed again.

    Parameters
    ----------
    recipe : str
        Hash of everything that the arrays were computed from, see `engine.project.folder.stage_key`.
    arrays : mapping of str to array
    """
    entries: dict[str, Any] = {_HEADER: np.array(json.dumps({"recipe": recipe})), **arrays}
    try:
        with atomic_write(path) as stream:
            np.savez(stream, **entries)
    except DiskError as error:
        _LOG.info("%s is not kept: %s", path.name, error)


def read_kept_arrays(path: Path, recipe: str, specs: Mapping[str, ArraySpec]) -> dict[str, NDArray[Any]] | None:
    """Return the arrays of `path`; None when it is missing, damaged or was made from another `recipe`.

    Parameters
    ----------
    recipe : str
        See `keep_arrays`.
    specs : mapping of str to ArraySpec
        What the arrays must be, see `read_arrays`.
    """
    try:
        arrays = read_arrays(path, {_HEADER: _TEXT, **specs}, advice=_ADVICE)
        header = parse_json(str(arrays.pop(_HEADER)), {"recipe": str}, source=str(path), advice=_ADVICE)
    except FormatError:
        return None
    return arrays if header["recipe"] == recipe else None
