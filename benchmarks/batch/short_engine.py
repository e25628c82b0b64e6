"""The real engine with short stages, for workers that are killed; they start with ``--preload`` of this module."""

from __future__ import annotations

import os
import sys

from engine.workers.jobs import engine_run

from ..security.kills_engine import shorten_stages


def dask_setup(worker: object) -> None:
    """Let this worker's engines have short stages; Dask calls it."""
    engine_run._MODULE = __name__


if __name__ == "__main__":
    shorten_stages()
    code = engine_run._main()
    sys.stdout.flush()
    os._exit(code)
