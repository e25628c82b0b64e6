"""Which device is used: a card that passed its self-test in another process, else the processor with the reason."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from engine.core.child_process import ChildFailure
from engine.core.errors import EnvironmentProblem
from engine.rasterizer.devices import (
    PROCESSOR,
    Device,
    choose_device,
    describe_cards,
    device_words,
    fallback,
    run_on,
    training_stopped,
)
from engine.rasterizer.gpu import adapters as wgpu_adapters

CARD = Device("gpu", "Card (Vulkan)", max_buffer_bytes=2 << 30, memory=8 << 30)
NO_CARD = "this computer has no graphics card with Vulkan, Metal or DirectX 12"


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for what is kept of cards, instead of the user's."""
    monkeypatch.setattr("engine.rasterizer.gpu.tested._folder", lambda: tmp_path / "cards")
    return tmp_path / "cards"


def answer(monkeypatch: pytest.MonkeyPatch, card: Device | None, reason: str = "") -> None:
    """Let the child process find this."""
    found = asdict(card or Device(reason=reason))
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", lambda *_, **__: found)


def adapters(monkeypatch: pytest.MonkeyPatch, cards: list[str], software: list[str]) -> None:
    lines = {False: cards, True: software}
    monkeypatch.setattr("engine.rasterizer.gpu.describe_adapters", lambda software=False: lines[software])


def test_card_that_works_is_used_without_being_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    answer(monkeypatch, CARD)
    device = choose_device("auto")
    assert (device.backend, device.name, device.reason) == ("gpu", "Card (Vulkan)", "")
    assert not device.required and choose_device("gpu") == replace(device, required=True)


def test_without_a_card_the_processor_is_used_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    answer(monkeypatch, None, NO_CARD)
    device = choose_device("auto")
    assert device == Device("cpu", "cpu", NO_CARD)
    assert device_words(device.name, device.reason) == f"the processor, because {NO_CARD}"
    with pytest.raises(EnvironmentProblem, match=f"{NO_CARD}; use --device cpu"):
        choose_device("gpu")


def test_processor_that_is_asked_for_needs_no_look_at_the_cards(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("looked for a card")

    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", fail)
    device = choose_device("cpu")
    assert device_words(device.name, device.reason) == "the processor"


def test_driver_that_crashes_in_the_test_does_not_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object, **__: object) -> None:
        raise ChildFailure("Testing the graphics card crashed (SIGSEGV).", "crash")

    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", crash)
    assert choose_device("auto").reason == "testing the graphics card crashed (SIGSEGV)"


def test_software_adapter_is_named_and_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    adapters(monkeypatch, [], ["llvmpipe (Vulkan, driver Mesa, CPU, ...)"])
    found = describe_cards()
    assert found["backend"] == "cpu" and found["reason"] == NO_CARD
    assert "none with Vulkan" in found["found"] and "llvmpipe" in found["found"] and "is software" in found["found"]


def test_card_is_described_with_the_result_of_its_self_test(monkeypatch: pytest.MonkeyPatch) -> None:
    adapters(monkeypatch, ["Card (Vulkan, driver 1.2, DiscreteGPU, buffers to 2048 MiB)"], [])
    gpu = SimpleNamespace(name="Card", backend="Vulkan", max_binding_bytes=2 << 30, shares_memory=False)
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: gpu)
    monkeypatch.setattr("engine.rasterizer.devices.card_memory", lambda name: 8 << 30)
    found = describe_cards()
    assert Device(**found) == CARD
    assert "driver 1.2" in found["found"] and "8 GiB memory; self-test" in found["found"]
    gpu.shares_memory = True
    assert describe_cards(always_test=True)["memory"] is None

    def refuse() -> None:
        raise EnvironmentProblem("the graphics card Card computes a test picture wrongly; use the CPU.")

    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", refuse)
    found = describe_cards(always_test=True)
    assert found["backend"] == "cpu" and found["reason"] == "the graphics card Card computes a test picture wrongly"


def test_card_is_tested_once_for_a_driver_and_again_after_it_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    gpu = SimpleNamespace(name="Card", backend="Vulkan", max_binding_bytes=2 << 30, shares_memory=False)
    tests: list[str] = []
    monkeypatch.setattr("engine.rasterizer.gpu.open_adapter", lambda: gpu)
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: tests.append("tested") or gpu)
    monkeypatch.setattr("engine.rasterizer.devices.card_memory", lambda name: 8 << 30)

    def n_tests(driver: str = "1.2", *, always_test: bool = False) -> int:
        adapters(monkeypatch, [f"Card (Vulkan, driver {driver})"], [])
        assert Device(**describe_cards(always_test=always_test)) == CARD
        return len(tests)

    assert [n_tests(), n_tests()] == [1, 1]
    assert [n_tests("1.3"), n_tests()] == [2, 2]
    assert n_tests(always_test=True) == 3
    fallback(EnvironmentProblem("the graphics card Card stopped working; use the CPU."))
    assert n_tests() == 4


def test_card_that_fails_its_self_test_is_tested_in_the_next_run(monkeypatch: pytest.MonkeyPatch, kept: Path) -> None:
    adapters(monkeypatch, ["Card (Vulkan, driver 1.2)"], [])

    def refuse() -> None:
        raise EnvironmentProblem("the graphics card Card computes a test picture wrongly; use the CPU.")

    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", refuse)
    assert describe_cards()["backend"] == "cpu" and not kept.exists()


def test_python_without_wgpu_uses_the_processor_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    # Without its cache, so that the card that other tests have opened stays open.
    monkeypatch.setattr(wgpu_adapters, "_wgpu", wgpu_adapters._wgpu.__wrapped__)
    monkeypatch.setitem(sys.modules, "wgpu", None)
    found = describe_cards()
    assert found["backend"] == "cpu" and found["reason"].startswith("this Python has no wgpu for graphics cards")
    assert "set up the engine again" in found["found"]


def test_training_that_the_card_ends_says_how_to_continue() -> None:
    device = Device("gpu", "Card (Vulkan)")
    full = EnvironmentProblem("the memory of the graphics card Card is full; train fewer Gaussians, or use the CPU.")
    message = str(training_stopped(device, full))
    assert message.startswith(
        "Training on Card (Vulkan) stopped, because the memory of the graphics card Card is full."
    )
    assert "Run again to continue" in message and "--device cpu" in message and "smaller preset" in message
    other = EnvironmentProblem("The memory of this machine is full. Close other programs.")
    assert training_stopped(device, other) is other
    assert training_stopped(Device("cpu", "cpu"), full) is full


def test_processor_replaces_a_card_that_fails_unless_the_user_asked_for_it() -> None:
    def compute(device: Device) -> str:
        if device.backend == "gpu":
            raise EnvironmentProblem("the memory of the graphics card Card is full; use the CPU.")
        return "picture"

    device = Device("cpu", "cpu", "the memory of the graphics card Card is full")
    assert run_on(Device("gpu", "Card"), compute) == ("picture", device)
    assert run_on(PROCESSOR, compute) == ("picture", PROCESSOR)
    with pytest.raises(EnvironmentProblem, match="is full"):
        run_on(Device("gpu", "Card", required=True), compute)
