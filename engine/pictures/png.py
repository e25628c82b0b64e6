"""Writing of pictures as PNG files."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.files import write_file


def write_png(
    path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.bool_], *, description: str = ""
) -> None:
    """Write a picture atomically as a PNG file.

    Parameters
    ----------
    picture : array of shape [H, W] or [H, W, 3], uint8, or [H, W], uint16 or bool (white where it is True)
    description : str
        Text stored under the key ``Description`` in the file.

    Raises
    ------
    DiskError
        If the file cannot be written.
    """
    write_file(path, encode_png(picture, description=description))


def encode_png(picture: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.bool_], *, description: str = "") -> bytes:
    """Return a picture as a PNG file; the parameters are those of `write_png`."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info, file = PngInfo(), io.BytesIO()
    if description:
        info.add_itxt("Description", description)
    Image.fromarray(np.ascontiguousarray(picture)).save(file, format="PNG", pnginfo=info)
    return file.getvalue()
