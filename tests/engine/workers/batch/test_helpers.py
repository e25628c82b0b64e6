"""Free workers of a cluster share the work of an engine, and what it makes has the bits of one computer."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.batch.runs import Cluster
from engine.core.errors import Cancelled
from engine.core.shares import Need, helped_by
from engine.workers.batch.helpers import ClusterHelpers
from tests.conftest import wait_until
from tests.engine.cameras.conftest import room  # noqa: F401
from tests.engine.cameras.test_matching import content, features, match, matched  # noqa: F401

ONE_CORE = Need(cores=1, memory=1_000_000)
LINUX = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and two workers of one core each. One that a test kills is started again by its nanny."""
    made = Cluster(tmp_path_factory.mktemp("cluster"), preload="tests.engine.workers.batch.quick_engine")
    made.start_scheduler()
    for core in "00":
        made.start_worker(environment={"GAUSSIAN_HERITAGE_CORES": core})
    yield made
    made.stop()


@pytest.fixture
def helpers(cluster: Cluster) -> ClusterHelpers:
    """The two workers, which have nothing to do."""
    wait_until(lambda: len(cluster.worker_processes()) == 2)
    return ClusterHelpers(cluster.address)


def children_of(process: int) -> list[int]:
    """The processes that a process started and that run."""
    found = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = file.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if int(parent) == process and state != "Z":
            found.append(int(file.parent.name))
    return found


def once_one_helps(helpers: ClusterHelpers, cluster: Cluster, act: Callable[[int], None]) -> Callable[[float], None]:
    """Return a progress callback that calls `act` with a worker whose processes run, once."""
    done: list[int] = []
    # Asked now: to ask takes longer than a process of a worker may run.
    workers = cluster.worker_processes()

    def watch(fraction: float) -> None:
        busy = [one for one in workers if children_of(one)] if helpers.begun and not done else []
        if busy:
            done.append(1)
            act(busy[0])

    return watch


def test_free_workers_are_found_with_the_cores_that_they_may_use(helpers: ClusterHelpers) -> None:
    assert [one.places(ONE_CORE) for one in helpers.free()] == [1, 1]
    # 6 GB each, see `Cluster.start_worker`.
    assert [one.places(Need(cores=1, memory=7_000_000_000)) for one in helpers.free()] == [0, 0]


@LINUX
def test_pairs_matched_on_three_computers_have_the_bits_of_one(
    helpers: ClusterHelpers,
    features: Path,  # noqa: F811
    matched: Path,  # noqa: F811
) -> None:
    with helped_by(lambda: helpers):
        match(features, 1)
    assert helpers.begun and not helpers.failed
    assert content(features) == content(matched)


@LINUX
def test_what_a_killed_worker_had_taken_is_done_again(
    helpers: ClusterHelpers,
    cluster: Cluster,
    features: Path,  # noqa: F811
    matched: Path,  # noqa: F811
) -> None:
    killed: list[int] = []

    def kill(worker: int) -> None:
        # The process here and that of the worker have begun.
        wait_until(lambda: len(list((features.parent / "shares").glob("process-*"))) >= 2)
        os.kill(worker, signal.SIGKILL)
        killed.append(worker)

    with helped_by(lambda: helpers):
        match(features, 1, report=once_one_helps(helpers, cluster, kill))
    assert killed
    assert content(features) == content(matched)


@LINUX
def test_stopped_engine_leaves_nothing_on_a_worker(
    helpers: ClusterHelpers,
    cluster: Cluster,
    features: Path,  # noqa: F811
) -> None:
    halted: list[int] = []

    def halt(worker: int) -> None:
        halted.extend(children_of(worker))
        for process in halted:
            os.kill(process, signal.SIGSTOP)

    with helped_by(lambda: helpers), pytest.raises(Cancelled):
        match(features, 1, report=once_one_helps(helpers, cluster, halt), should_stop=lambda: bool(halted))
    assert halted
    wait_until(lambda: not any(Path(f"/proc/{process}").exists() for process in halted))
    wait_until(lambda: len(helpers.free()) == 2)
