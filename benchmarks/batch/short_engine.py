"""The real engine with short stages, for workers that are killed; they start with ``--preload`` of this module."""

from __future__ import annotations

import os
import sys

from engine.workers.batch import helped_engine, stage_task

from ..security.kills_engine import shorten_stages


def dask_setup(worker: object) -> None:
    """Let this worker's engines have short stages; Dask calls it."""
    stage_task.MODULE = __name__


if __name__ == "__main__":
    shorten_stages()
    code = helped_engine.main()
    sys.stdout.flush()
    os._exit(code)
