"""Memory and cores of this machine are reported where the operating system reports them."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from engine.machine import PeakMemory, cpu_seconds, describe_machine, free_memory, peak_memory


def test_machine_is_described() -> None:
    machine = describe_machine()
    assert machine.cores >= 1
    assert str(machine.cores) in machine.name


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_peak_is_that_of_the_block_and_not_of_earlier_work() -> None:
    large = np.ones(40_000_000)  # 320 MB
    with PeakMemory.of() as with_large:
        pass
    del large
    with PeakMemory.of() as after:
        small = np.ones(1_000_000)
    assert with_large.bytes is not None and after.bytes is not None
    assert with_large.bytes - after.bytes > 200_000_000
    assert small.sum() == 1_000_000
    assert (free_memory() or 0) > 0 and (peak_memory() or 0) > 0


def test_unknown_peak_is_reported_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.machine._reset_peak", lambda: False)
    monkeypatch.setattr("engine.machine.peak_memory", lambda: 5)
    with PeakMemory.of() as peak:
        pass
    assert peak.bytes is None


def test_container_with_a_limit_has_less_free(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("cgroup")
    (folder / "memory.max").write_text("3000000\n")
    (folder / "memory.current").write_text("1000000\n")
    monkeypatch.setattr("engine.machine._CGROUP", folder)
    monkeypatch.setattr("engine.machine.sys.platform", "linux")
    monkeypatch.setattr("engine.machine._kibibytes", lambda file, name: 9_000_000)
    assert free_memory() == 2_000_000
    (folder / "memory.max").write_text("max\n")
    assert free_memory() == 9_000_000


def test_work_takes_cpu_seconds() -> None:
    before = cpu_seconds()
    sum(range(3_000_000))
    assert cpu_seconds() > before
