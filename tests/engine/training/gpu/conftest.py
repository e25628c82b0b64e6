"""The card of the gpu tests: a software adapter, or with the marker ``gpu`` a graphics card."""

from __future__ import annotations

import pytest

from engine.rasterizer.gpu import Gpu

from ...cards import card_or_skip


@pytest.fixture(autouse=True)
def opened_gpu(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Gpu:
    """Let `rasterize` use any adapter, also the processor; tests marked ``gpu`` get a card."""
    gpu = card_or_skip(software=request.node.get_closest_marker("gpu") is None)
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: gpu)
    return gpu
