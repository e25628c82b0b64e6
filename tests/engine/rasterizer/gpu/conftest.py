"""The card of the gpu tests: a software adapter, or with the marker ``gpu`` a graphics card."""

from __future__ import annotations

import pytest

from engine.errors import EnvironmentProblem
from engine.rasterizer.gpu import Gpu, open_gpu


@pytest.fixture(autouse=True)
def opened_gpu(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Gpu:
    """Let `rasterize` use any adapter, also the processor; tests marked ``gpu`` get a card."""
    try:
        gpu = open_gpu(software=request.node.get_closest_marker("gpu") is None)
    except EnvironmentProblem as problem:
        pytest.skip(f"no adapter for the gpu backend: {problem}")
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: gpu)
    return gpu
