"""The engine as the child process of a worker, helped by the workers of the cluster that have nothing to do."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from typing import TYPE_CHECKING

from ...core.shares import helped_by
from ..jobs import run_as_child

if TYPE_CHECKING:
    from .helpers import ClusterHelpers

SCHEDULER_VARIABLE = "GAUSSIAN_HERITAGE_SCHEDULER"
"""Environment variable: address of the scheduler; empty where nobody helps."""


@functools.cache
def _helpers() -> ClusterHelpers:
    from .helpers import ClusterHelpers

    return ClusterHelpers(os.environ[SCHEDULER_VARIABLE])


def main() -> int:
    """Run the engine in this process, and return its exit code."""
    with helped_by(_helpers) if os.environ.get(SCHEDULER_VARIABLE) else contextlib.nullcontext():
        return run_as_child()


if __name__ == "__main__":
    _code = main()
    sys.stdout.flush()
    # Not `sys.exit`: the thread that waits for the parent holds standard input.
    os._exit(_code)
