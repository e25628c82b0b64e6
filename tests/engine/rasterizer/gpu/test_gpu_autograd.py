"""Pictures of `rasterize` on a card leave no memory behind."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import pytest
import torch

from engine.rasterizer.api import rasterize
from engine.rasterizer.gpu import autograd
from engine.rasterizer.gpu.frame import Frame
from tests.engine.rasterizer.scenes import camera, random_scene


def test_memory_of_a_picture_without_gradients_is_free_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    buffers: list[weakref.ref[Any]] = []

    class Watched(Frame):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            buffers.append(weakref.ref(self.buffers["entries"]))

    monkeypatch.setattr(autograd, "Frame", Watched)
    scene = random_scene(400, size=0.7)  # more pairs than the first frame has room for
    gc.disable()
    try:
        with torch.no_grad():
            rasterize(
                scene.means, scene.quats, scene.scales, scene.opacities, camera=camera(320, 240), sh=scene.sh,
                backend="gpu",
            )  # fmt: skip
        assert len(buffers) > 1
        assert [buffer() for buffer in buffers] == [None] * len(buffers)
    finally:
        gc.enable()
