"""Pictures of the engine, beside which those of Blender are compared.

example: python -m benchmarks.blender.likeness PROJECT PHOTO SIDE PICTURE.npy
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.scene import Camera, focal_and_center, read_camera_set

from ..pictures import psnr, rendered_by_engine


def engine_picture(
    project: Path, photo: str, side: int, work: Path, object_id: str | None = None
) -> NDArray[np.float64]:
    """Return the engine's picture of the view of a photo without lens distortion, shape [H, W, 3], 0 to 1.

    Parameters
    ----------
    project : Path
    photo : str
    side : int
        Longest side in pixels.
    work : Path
        Folder for files.
    object_id : str, optional
        Of this object alone, on black; otherwise of the scene.
    """
    camera = next(one for one in read_camera_set(project / "cameras").cameras if one.photo == photo)
    words = [] if object_id is None else ["--object", object_id]
    return rendered_by_engine(project, pinhole(camera, side), work, *words)


def pinhole(camera: Camera, side: int) -> dict[str, Any]:
    """Return the view of a photo as Blender renders it with the longest side `side`, see `look_through`."""
    fx, fy, cx, cy = focal_and_center(camera)
    shrink = min(1.0, side / max(camera.width, camera.height))
    width, height = max(1, round(camera.width * shrink)), max(1, round(camera.height * shrink))
    x, y = width / camera.width, height / camera.height
    return {
        "width": width, "height": height, "fx": fx * x, "fy": fy * y, "cx": cx * x, "cy": cy * y,
        "viewmat": camera.viewmat.tolist(),
    }  # fmt: skip


def main() -> None:
    """Print the PSNR of a picture of a photo's view, sRGB values in a file of NumPy."""
    project, photo, side, picture = sys.argv[1:]
    with tempfile.TemporaryDirectory() as work:
        expected = engine_picture(Path(project), photo, int(side), Path(work))
    print(psnr(np.load(picture), expected))


if __name__ == "__main__":
    main()
