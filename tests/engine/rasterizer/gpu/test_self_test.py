"""The self-test of a card, which comes before its first use anywhere."""

from __future__ import annotations

import torch

from engine.rasterizer.gpu import Gpu
from engine.rasterizer.gpu.self_test import check_gpu


def test_card_passes_its_self_test_where_gradients_are_off(opened_gpu: Gpu) -> None:
    with torch.no_grad():
        check_gpu(opened_gpu)
