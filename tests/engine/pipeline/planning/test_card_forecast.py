"""The forecast of a card's memory is that of the buffers that a trainer makes."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import EnvironmentProblem
from engine.pipeline.planning.card_forecast import card_bytes, gaussians_that_fit
from engine.rasterizer.gpu import FrameSize, open_adapter
from engine.training.gpu import GpuParameters
from engine.training.gpu.training_frame import TrainingFrame
from engine.training.losses import GpuExposures

N, ROOM, WIDTH, HEIGHT = 20_000, 25_000, 640, 480


@pytest.mark.parametrize(("sh_degree", "features"), [(3, True), (0, False)])
def test_forecast_is_the_sum_of_the_buffers(sh_degree: int, features: bool) -> None:
    try:
        gpu = open_adapter(software=True)
    except EnvironmentProblem as problem:
        pytest.skip(f"no adapter for the gpu backend: {problem}")
    n_sh, n_features = (sh_degree + 1) ** 2, 16 * features
    shapes = {"means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": (), "sh_dc": (1, 3)}
    shapes |= {"sh_rest": (n_sh - 1, 3)} if sh_degree else {}
    shapes |= {"features": (n_features,)} if features else {}
    values = {name: np.zeros((N, *shape), np.float32) for name, shape in shapes.items()}
    parameters = GpuParameters(gpu, values, room=ROOM)
    size = FrameSize(N, n_sh, n_features, WIDTH, HEIGHT, capacity=3 * ROOM, room=ROOM)
    status = gpu.device.create_buffer(size=512, usage=0x80 | 0x8 | 0x4)
    frame = TrainingFrame(gpu, size, parameters, GpuExposures(gpu, np.zeros((1, 3), np.float32)), status, {})
    made = sum(
        buffer.size for buffer in {id(b): b for b in [*frame.buffers.values(), *parameters.buffers.values()]}.values()
    )
    expected = card_bytes(
        N, sh_degree=sh_degree, features=features, width=WIDTH, height=HEIGHT, n_photos=0
    )  # fmt: skip
    # The forecast leaves out sums by blocks and the samples of the losses.
    assert made == pytest.approx(expected, rel=0.1)


def test_more_photos_leave_room_for_fewer_gaussians() -> None:
    scene = {"sh_degree": 3, "features": True, "width": 1600, "height": 1200}
    limits = {"own_memory": 8 << 30, "free": None, "max_buffer_bytes": 2 << 30}
    few, many, most = (gaussians_that_fit(**limits, **scene, n_photos=n) for n in (50, 300, 3000))
    assert few > many > 0 == most
    assert card_bytes(few, **scene, n_photos=50) <= 8 << 30
