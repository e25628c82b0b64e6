"""Pictures that are compared with those of the engine."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from engine.core.engine_process import engine_command

from .places import ROOT


def read_picture(file: Path) -> NDArray[np.float64]:
    """Return a picture file as [H, W, 3], sRGB in [0, 1]."""
    with Image.open(file) as picture:
        return np.asarray(picture.convert("RGB"), np.float64) / 255


def rendered_by_engine(project: Path, camera: dict[str, Any], folder: Path, *words: str) -> NDArray[np.float64]:
    """Return what the engine's command `render` makes of a scene, [H, W, 3], sRGB in [0, 1].

    Parameters
    ----------
    project : Path
    camera : dict
        As the command reads it from JSON.
    folder : Path
        For files.
    *words : str
        More arguments.
    """
    file, out = folder / "camera.json", folder / "engine.png"
    file.write_text(json.dumps(camera))
    command = engine_command(
        "render", project, "--camera", file, "--out", out, "--overwrite", "--device", "cpu", *words
    )
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return read_picture(out)


def psnr(picture: ArrayLike, expected: ArrayLike) -> float:
    """Return the PSNR in dB of a picture, clipped to [0, 1], beside another one."""
    return float(-10 * np.log10(np.mean((np.clip(picture, 0, 1) - expected) ** 2)))
