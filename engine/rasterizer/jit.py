"""How this room compiles: Numba's options and where its compiled code is kept. Imported before every kernel."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

# The kernels say themselves what is a vector: LLVM's search for more only takes time. Numba reads this at its import.
os.environ.setdefault("NUMBA_OPT", "2")
os.environ.setdefault("NUMBA_LOOP_VECTORIZE", "0")

import numba  # noqa: E402

__all__ = ["INNER", "JIT", "cache_folder"]

_log = logging.getLogger(__name__)

JIT: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy", "boundscheck": False}
"""No fast-math: a compiler that may re-order sums could make forward and backward disagree about a threshold."""


def cache_folder() -> Path:
    """Return the folder of compiled kernels, in the user's cache folder unless ``NUMBA_CACHE_DIR`` names another.

    Numba notices a change only in the file that holds a kernel, not in the files it calls into; so the folder's name
    carries a hash of this whole room, and new code never meets old machine code.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(chosen) if chosen else user_cache_path("gaussian-heritage", appauthor=False) / "numba"
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return root / f"rasterizer-{digest.hexdigest()[:12]}"


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError as problem:
        _log.warning("compiled kernels cannot be kept in %s (%s); every start compiles them again", folder, problem)
        return False


INNER: dict[str, Any] = {**JIT, "cache": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""For what only kernels call: compiled into them, so that a door to Python and a cache of its own are wasted."""

numba.config.CACHE_DIR = str(cache_folder())
JIT["cache"] = _is_writable(cache_folder())
