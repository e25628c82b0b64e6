"""Memory and cores of this machine are reported where the operating system reports them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from engine.core.system import PeakMemory, card_memory, cpu_seconds, describe_machine, free_memory, peak_memory
from tests.conftest import ROOT


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
    monkeypatch.setattr("engine.core.system.machine._reset_peak", lambda: False)
    monkeypatch.setattr("engine.core.system.machine.peak_memory", lambda: 5)
    with PeakMemory.of() as peak:
        pass
    assert peak.bytes is None


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder of control groups, in which this process is in ``/`` of version 2; 9 MB are free on the machine."""
    if sys.platform == "win32":
        pytest.skip("Windows has no control groups")
    (tmp_path / "own").write_text("0::/\n")
    monkeypatch.setattr("engine.core.system.machine._CGROUP", tmp_path)
    monkeypatch.setattr("engine.core.system.machine._OWN_GROUPS", tmp_path / "own")
    monkeypatch.setattr("engine.core.system.machine.sys.platform", "linux")
    monkeypatch.setattr("engine.core.system.machine._kibibytes", lambda file, name: 9_000_000)
    return tmp_path


def limit(folder: Path, most: str, used: str, *, names: tuple[str, str] = ("memory.max", "memory.current")) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, value in zip(names, (most, used), strict=True):
        (folder / name).write_text(value + "\n")


def test_container_with_a_limit_has_less_free(groups: Path) -> None:
    assert free_memory() == 9_000_000
    limit(groups, "3000000", "1000000")
    assert free_memory() == 2_000_000
    limit(groups, "max", "1000000")
    assert free_memory() == 9_000_000


def test_files_that_a_container_caches_count_as_free(groups: Path) -> None:
    limit(groups, "3000000", "2900000")
    (groups / "memory.stat").write_text("anon 100000\ninactive_file 2500000\n")
    assert free_memory() == 2_600_000


def test_smallest_limit_of_nested_groups_holds(groups: Path) -> None:
    (groups / "own").write_text("1:cpu:/x\n0::/user/job\n")
    limit(groups / "user", "5000000", "2000000")
    limit(groups / "user" / "job", "8000000", "1000000")
    assert free_memory() == 3_000_000
    limit(groups / "user" / "job", "2000000", "3000000")
    assert free_memory() == 0


def test_limit_of_the_first_version_of_control_groups_holds(groups: Path) -> None:
    (groups / "own").write_text("5:cpu:/job\n4:hugetlb,memory:/job\n")
    names = ("memory.limit_in_bytes", "memory.usage_in_bytes")
    limit(groups / "memory", str(2**63 - 4096), "7000000", names=names)
    limit(groups / "memory" / "job", "5000000", "1000000", names=names)
    assert free_memory() == 4_000_000


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits the address space")
@pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_limit_of_the_process_leaves_less_free(kind: str) -> None:
    code = f"""
import resource
resource.setrlimit(resource.{kind}, (300_000_000, 300_000_000))
from engine.core.system import free_memory
before = free_memory()
held = bytearray(100_000_000)
print(before, free_memory())
"""
    output = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    before, after = map(int, output.split())
    assert 100_000_000 < before < 300_000_000
    # The array and the allocator's padding.
    assert 99_000_000 < before - after < 105_000_000


def test_work_takes_cpu_seconds() -> None:
    before = cpu_seconds()
    sum(range(3_000_000))
    assert cpu_seconds() > before


def test_memory_of_a_card_is_what_its_driver_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def smi(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0, "NVIDIA L4, 23034\nNVIDIA T4, 15360\nNVIDIA L4, 20000\n")

    monkeypatch.setattr(subprocess, "run", smi)
    assert card_memory("NVIDIA L4") == 20000 << 20, "of two cards of one name, the smaller one"
    assert card_memory("NVIDIA A2") is None
    monkeypatch.setattr("engine.core.system.machine._GRAPHICS", tmp_path)
    assert card_memory("AMD Radeon") is None
    for number in (0, 1):
        device = tmp_path / f"card{number}" / "device"
        device.mkdir(parents=True)
        (device / "mem_info_vram_total").write_text("8589934592\n")
        # With two cards it is not known which one is meant.
        assert card_memory("AMD Radeon") == (8 << 30 if number == 0 else None)
    assert card_memory("Intel Arc") is None


def test_memory_of_a_card_is_unknown_without_the_tool_of_its_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise FileNotFoundError

    monkeypatch.setattr(subprocess, "run", missing)
    assert card_memory("NVIDIA L4") is None
