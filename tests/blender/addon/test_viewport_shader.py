"""The shader of the viewports draws anti-aliased Gaussians with the light they have, where graphics are there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
import pytest
from conftest import Part
from mathutils import Matrix

CHECK = "import gpu; gpu.init(); print(gpu.platform.renderer_get())"


@pytest.fixture(scope="module")
def graphics() -> None:
    """Skip unless this Blender opens a graphics context without a window; some end the process when they try."""
    if not hasattr(gpu, "init"):
        pytest.skip("this Blender has no graphics without a window")
    tried = subprocess.run(
        [sys.executable, "-c", f"import bpy; {CHECK}"], env=os.environ, check=False, capture_output=True
    )
    if tried.returncode:
        pytest.skip("this computer has no graphics")
    gpu.init()


@pytest.mark.parametrize("antialiased", [False, True])
def test_small_gaussians_keep_their_light(
    part: Part, random_gaussians: Callable[..., Any], graphics: None, tmp_path: Path, antialiased: bool
) -> None:
    sigma, distance, side = 0.4, 10.0, 64
    gaussians = replace(random_gaussians(1, degree=0), antialiased=antialiased)
    gaussians.means[:] = 0
    # A ball of `sigma` pixels: the picture is as wide as it is far away.
    gaussians.log_scales[:] = np.log(sigma * distance / side)
    gaussians.opacity_logits[:] = 2
    splats = part("gaussian_heritage_addon.splats.splats").SplatScene.create(
        "s", gaussians, bpy.context.scene.collection
    )
    view = part("gaussian_heritage_addon.splats.splat_view")
    window = Matrix(((2, 0, 0, 0), (0, 2, 0, 0), (0, 0, -1.02, -0.2), (0, 0, -1, 0)))
    offscreen = gpu.types.GPUOffScreen(side, side, format="RGBA32F")
    objects = [splats.object]
    view.draw_to(
        offscreen, view.tables_of(objects), objects, Matrix.Translation((0, 0, -distance)), window, view.Detail()
    )
    with offscreen.bind():
        read = gpu.state.active_framebuffer_get().read_color(0, 0, side, side, 4, 0, "FLOAT")
    read.dimensions = side * side * 4
    alpha = np.array(read, np.float32).reshape(side, side, 4)[..., 3]
    opacity = float(gaussians.opacities[0])
    variance = sigma**2 + 0.3
    kept = sigma**2 / variance if antialiased else 1.0
    # What is below 1/255 is not drawn: that is less than a fiftieth of the light.
    assert alpha.sum() == pytest.approx(opacity * kept * 2 * np.pi * variance, rel=0.03)
    assert alpha.max() <= opacity * kept
