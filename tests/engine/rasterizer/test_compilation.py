"""Kernels are compiled once per computer, by two processes, for the vector instructions of its processor."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from numba.core import event

from engine.scene.camera import PinholeCamera
from engine.training.adam import AdamState, adam_step
from engine.training.losses.photometric import photometric_loss
from tests.conftest import ROOT
from tests.engine.rasterizer.scenes import random_scene

_COMPILE = """
import logging
from engine.training.compilation import compile_kernels
logging.basicConfig()
compile_kernels()
"""
_STEP = """
from tests.engine.rasterizer.test_compilation import training_step
print(*training_step())
"""


def training_step() -> tuple[int, str]:
    """Return the number of kernels that a step compiled, and the hash of its picture and gradients."""
    with event.install_recorder("numba:compile") as compiled:
        camera = PinholeCamera(np.eye(4), np.array([[40.0, 0, 25], [0, 40, 20], [0, 0, 1]]), 50, 40)
        scene = random_scene(200, n_features=16).leaves(torch.float32)
        viewmat = torch.eye(4, dtype=torch.float64, requires_grad=True)
        raster = scene.render(camera, viewmat=viewmat)
        loss = photometric_loss(raster.image[..., :3].contiguous(), torch.full((40, 50, 3), 0.5))
        (loss + raster.image[..., 3:].square().mean() + raster.transmittance.mean()).backward()
        adam_step([(scene.means.detach(), scene.means.grad, 1e-3)], [AdamState.zeros_like(scene.means)])
    digest = hashlib.sha256(raster.image.detach().numpy().tobytes())
    for tensor in scene.tensors().values():
        digest.update(tensor.grad.numpy().tobytes())
    return len(compiled.buffer), digest.hexdigest()


_WITHOUT_AVX = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "+sse2"}


def _python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    settings = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run([sys.executable, "-c", code], env=settings, capture_output=True, text=True, check=True)


@pytest.mark.slow
def test_compiled_kernels_are_loaded_from_the_cache_and_a_processor_without_avx_gives_the_same_bits(
    tmp_path: Path,
) -> None:
    without_avx = {**_WITHOUT_AVX, "NUMBA_CACHE_DIR": str(tmp_path)}
    process = _python(_COMPILE, **without_avx)
    assert "compiling process failed" not in process.stderr
    n_compiled, digest = _python(_STEP, **without_avx).stdout.split()
    assert n_compiled == "0"
    assert training_step()[1] == digest
