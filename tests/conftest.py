"""What all tests share."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

# As `engine/__main__.py` does, before torch is imported: more than half of the CPU time of comparisons with the float64
# reference was spinning at barriers. Our own kernels have threads of their own, which never spin.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

ROOT = Path(__file__).resolve().parent.parent
PATIENCE = 600.0
"""Seconds after which a test that waits is taken to hang. A limit says nothing of speed: a busy machine is no fault."""


def wait_until(condition: Callable[[], object]) -> None:
    """Wait until `condition` returns something true."""
    give_up = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < give_up, "waited for something that did not happen"
        time.sleep(0.02)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The real photo sets; tests that need them are marked ``data`` and skipped where they are not."""
    return Path(os.environ["GAUSSIAN_HERITAGE_DATA"])


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name bytes by their argument: their content may differ between processes, as the time in a gzip header does."""
    return argname if isinstance(val, bytes) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip ``data`` tests where the real photo sets are not at hand, with the reason."""
    folder = os.environ.get("GAUSSIAN_HERITAGE_DATA")
    if folder and Path(folder).is_dir():
        return
    skip = pytest.mark.skip(reason="GAUSSIAN_HERITAGE_DATA does not name the folder of the real photo sets")
    for item in items:
        if "data" in item.keywords:
            item.add_marker(skip)


def pytest_collection_finish() -> None:
    """Leave what was collected out of the search for garbage in cycles: visiting it took a sixth of the CPU time."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the tests of a folder to one process, because they share fixtures that train, render or estimate."""
    from xdist.scheduler import LoadScopeScheduling

    class FolderScheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return nodeid.partition("::")[0].rpartition("/")[0]

    return FolderScheduling(config, log)
