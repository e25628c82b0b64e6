"""Options of Numba for all kernels, and the cache of compiled code. This module is imported before every kernel."""

from __future__ import annotations

import hashlib
import logging
import os
from pathlib import Path, PurePath
from typing import Any

from platformdirs import user_cache_path

# The kernels use vectors explicitly, so LLVM's automatic vectorization only costs time. Numba reads these variables
# when it is imported.
os.environ.setdefault("NUMBA_OPT", "2")
os.environ.setdefault("NUMBA_LOOP_VECTORIZE", "0")

import numba  # noqa: E402

from ..core.system import takes_path  # noqa: E402

_LOG = logging.getLogger(__name__)

LONGEST_PATH = PurePath("rasterizer_" + "0" * 40, "x" * 120)
"""A path as long as the longest of a file that Numba stores: folder of the package with its hash, name of the kernel with
its module, version of Python, suffix and a mark of a file that is being written. On Windows paths are limited."""

JIT: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy", "boundscheck": False}
"""Options of kernels that Python calls. Fast-math is off: with reordered sums, the forward and the backward pass could
disagree on whether a value passes a threshold."""


def cache_folder() -> Path:
    """Return the folder of compiled kernels, in the user's cache folder unless ``NUMBA_CACHE_DIR`` names another.

    Numba detects a change only in the file that defines a kernel, not in the files whose functions the kernel calls.
    The folder's name therefore contains a hash of all files of this package, so that old machine code is never loaded.
    """
    override = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(override) if override else user_cache_path("gaussian-heritage", appauthor=False) / "numba"
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return root / f"rasterizer-{digest.hexdigest()[:12]}"


def _takes_kernels(folder: Path) -> bool:
    """Return whether kernels can be stored in `folder`, which is created if it is missing; log a warning if not."""
    why = "its path is too long"
    try:
        if takes_path(folder, LONGEST_PATH):
            return True
    except OSError as problem:
        why = str(problem)
    _LOG.warning("compiled kernels cannot be stored in %s (%s); every start compiles them again", folder, why)
    return False


INNER: dict[str, Any] = {**JIT, "cache": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of functions that only kernels call. They are compiled into the kernels and need no wrapper for calls from
Python and no cache of their own."""

numba.config.CACHE_DIR = str(cache_folder())
JIT["cache"] = _takes_kernels(cache_folder())
