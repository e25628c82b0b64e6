"""The engine as the child process of a worker, helped by the workers of the cluster that have nothing to do."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Sequence

from ...core.shares import Helper, Helpers, helped_by
from ..jobs import run_as_child

SCHEDULER_VARIABLE = "GAUSSIAN_HERITAGE_SCHEDULER"
"""Environment variable: address of the scheduler; empty where nobody helps."""


class _Nobody:
    """The helpers of an engine that does not reach the scheduler."""

    def free(self) -> Sequence[Helper]:
        """See `Helpers`."""
        return ()


@functools.cache
def _helpers() -> Helpers:
    from .helpers import ClusterHelpers

    try:
        return ClusterHelpers(os.environ[SCHEDULER_VARIABLE])
    except (OSError, TimeoutError):
        return _Nobody()


def main() -> int:
    """Run the engine in this process, and return its exit code."""
    with helped_by(_helpers) if os.environ.get(SCHEDULER_VARIABLE) else contextlib.nullcontext():
        return run_as_child()


if __name__ == "__main__":
    _code = main()
    sys.stdout.flush()
    # Not `sys.exit`: the thread that waits for the parent holds standard input.
    os._exit(_code)
