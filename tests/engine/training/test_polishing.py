from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.core.errors import Cancelled
from engine.core.events import never_stop
from engine.scene import Gaussians, PinholeCamera
from engine.training import AloneTarget, train_alone
from engine.training.parameters import Parameters, render

CAMERA = PinholeCamera(viewmat=np.eye(4), K=np.array([[60.0, 0, 24], [0, 60, 18], [0, 0, 1]]), width=48, height=36)


def faint_ball() -> Gaussians:
    random = np.random.default_rng(1)
    n = 40
    return Gaussians(
        means=(random.normal(0, 0.3, (n, 3)) + [0, 0, 3]).astype(np.float32),
        log_scales=np.full((n, 3), np.log(0.12), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        opacity_logits=np.full(n, -1.5, np.float32),
        sh=random.normal(0, 0.5, (n, 1, 3)).astype(np.float32),
    )


def pictures(gaussians: Gaussians) -> tuple[torch.Tensor, torch.Tensor]:
    values = Parameters.from_gaussians(gaussians, sh_degree=0, features=False).values
    with torch.no_grad():
        raster = render(values, CAMERA, backend="cpu", sh_degree=0)
    return raster.image[..., :3].clone(), 1 - raster.transmittance


def opaque_target(gaussians: Gaussians, known: float = 1.0) -> AloneTarget:
    image, alpha = pictures(replace(gaussians, opacity_logits=np.full(len(gaussians), 3, np.float32)))
    return AloneTarget(CAMERA, image, alpha, torch.full(alpha.shape, known))


def test_gaussians_come_to_look_like_their_targets() -> None:
    ball = faint_ball()
    target = opaque_target(ball)
    trained = train_alone(ball, [target], steps=40, backend="cpu", should_stop=never_stop)
    distances = [float((pictures(one)[1] - target.alpha).abs().mean()) for one in (ball, trained)]
    assert distances[1] < 0.3 * distances[0]


def test_pixels_that_do_not_count_change_nothing() -> None:
    ball = faint_ball()
    trained = train_alone(ball, [opaque_target(ball, known=0)], steps=3, backend="cpu", should_stop=never_stop)
    np.testing.assert_allclose(trained.opacity_logits, ball.opacity_logits, atol=1e-5)


def test_training_alone_can_be_stopped() -> None:
    ball = faint_ball()
    with pytest.raises(Cancelled, match="no object was stored"):
        train_alone(ball, [opaque_target(ball)], steps=3, backend="cpu", should_stop=lambda: True)
