"""A scheduler and workers as programs, with an engine whose stages take no time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.batch.runs import Cluster

MakeFolders = Callable[..., list[Path]]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler; a test starts the workers."""
    made = Cluster(tmp_path / "cluster", preload="tests.engine.batch.quick_engine")
    made.start_scheduler()
    yield made
    made.stop()


@pytest.fixture
def make_folders(tmp_path: Path) -> MakeFolders:
    """Makes photo folders, each with one file that stands for a photo."""

    def make(count: int, **files: str) -> list[Path]:
        folders = [tmp_path / "scans" / f"scan_{number}" for number in range(count)]
        for folder in folders:
            folder.mkdir(parents=True)
            (folder / "photo.jpg").write_text(folder.name)
            for name, text in files.items():
                (folder / name).write_text(text)
        return folders

    return make
