"""The stiff and extreme cases of the stability suite, with the gpu backend in the place of ``cpu``.

The cases of the loss and of Adam render nothing and are left out: they call the processor's functions. Loss and Adam
of the card are compared with these in test_gpu_loss.py and test_gpu_training.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import torch

from engine.quality.stability import scenes
from engine.quality.stability.cases import CASES, Case
from engine.quality.stability.table import run_case

RENDERED = [case for case in CASES if not case.name.startswith(("adam", "loss"))]


@pytest.fixture(autouse=True)
def gpu_for_cpu(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Render what the suite renders with ``cpu`` with ``gpu``; one thread of torch, as in the suite's own tests."""
    original = scenes.rasterize

    def with_gpu(*arrays: Any, backend: str, **options: Any) -> Any:
        return original(*arrays, backend="gpu" if backend == "cpu" else backend, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(scenes, "rasterize", with_gpu)
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.slow
@pytest.mark.parametrize("case", RENDERED, ids=lambda case: case.name)
def test_case_ends_as_expected(case: Case) -> None:
    row = run_case(case)
    assert row.green, f"expected {case.expected}, found {row.finding}"
