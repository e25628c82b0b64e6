"""The graphics card that tests open."""

from __future__ import annotations

import pytest

from engine.core.errors import EnvironmentProblem
from engine.rasterizer.gpu import Gpu, open_adapter, open_gpu


def card_or_skip(*, software: bool = True) -> Gpu:
    """Return the card, or with `software` any adapter; skip where there is none, and fail where the self-test does."""
    try:
        open_adapter(software=software)
    except EnvironmentProblem as problem:
        pytest.skip(f"no adapter for the gpu backend: {problem}")
    return open_gpu(software=software)


def opened_for(node: pytest.Item | pytest.Module, patch: pytest.MonkeyPatch) -> Gpu:
    """Let `rasterize` use any adapter, also the processor; what is marked ``gpu`` gets a card."""
    gpu = card_or_skip(software=node.get_closest_marker("gpu") is None)
    patch.setattr("engine.rasterizer.gpu.open_gpu", lambda: gpu)
    return gpu


@pytest.fixture(autouse=True)
def opened_gpu(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Gpu:
    """The card of a test, see `opened_for`."""
    return opened_for(request.node, monkeypatch)
