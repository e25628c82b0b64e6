"""A ball of the blob scene, the rest of it, and crops of photos in which the ball is striped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.pictures.scene import Scene
from engine.scene import Gaussians
from engine.training import DetailCrop

from ..objects.test_detail import patterned
from ..pictures.blob_scene import RED, as_pinhole, camera_at, make_scene

N_VIEWS = 6
SCALE = 2
"""Size of the pixels of a crop relative to its maps."""


@dataclass(frozen=True)
class DetailScene:
    """What `train_detail` takes."""

    gaussians: Gaussians
    others: Gaussians
    crops: list[DetailCrop]

    def psnr(self, gaussians: Gaussians) -> float:
        """Return the PSNR in dB of Gaussians alone over black, inside of the ball."""
        errors = []
        for crop in self.crops:
            picture = Scene(gaussians).render(crop.camera, color=True).channels * crop.gain
            inside = crop.inside.repeat(SCALE, axis=0).repeat(SCALE, axis=1)
            errors.append(np.square(np.clip(picture, 0, 1) - crop.pixels / 255)[inside].mean())
        return float(-10 * np.log10(np.mean(errors)))


def detail_scene(*, gain: float = 0.9) -> DetailScene:
    """Return the red ball and the crops of `N_VIEWS` photos, all of whose pixels are in them."""
    scene = make_scene()
    red = scene.part == RED
    fine, _ = patterned(scene.gaussians, scene.part)
    own, others = (replace(scene.gaussians[rows], features=None) for rows in (red, ~red))
    own = replace(own, log_scales=own.log_scales + np.array([0.2, -0.3, 0.0], np.float32))  # so that rotations matter
    crops = []
    for number in range(N_VIEWS):
        small = as_pinhole(camera_at(0.2 + 2 * np.pi * number / N_VIEWS, f"view_{number}.png"))
        camera = small.scaled(SCALE)
        seen = Scene(fine).render(camera, color=True)
        share = Scene(scene.gaussians).share(small, red)
        alone = Scene(own).render(small, color=True).alpha
        pixels = (np.clip(gain * seen.channels, 0, 1) * 255).astype(np.uint8)
        inside = share > 0.9
        shown = inside | ((alone > 0.5) & (share > 0.4))
        crops.append(
            DetailCrop(
                f"view_{number}.png",
                camera,
                pixels,
                share > 0.02,
                inside,
                shown,
                shown,
                np.clip((share - 0.3) / 0.4, 0, 1).astype(np.float32),
                share + (1 - alone) > 0.2,
                np.full(3, gain, np.float32),
                1.0 + number,
            )  # fmt: skip
        )
    return DetailScene(own, others, crops)
