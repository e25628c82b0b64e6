"""Reader of SOG, the small format of PlayCanvas for the web: ``meta.json`` and lossless WebP pictures, alone or zipped.

Version 2 is described at https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog. A pixel of each
picture belongs to one Gaussian: positions have 16 bits of the logarithm of their distance from 0 in two pictures, and
rotations three components of 8 bits. Log-scales and colours are numbers in codebooks of 256 values, opacities have 8
bits, and harmonics are a number in a palette, whose own values are in a codebook. In version 1, which states no
version, codebooks are ranges. Values are in the axes of the PLY file that was packed, mostly with -Y up.

Pictures are decoded by a function that is given, because neither NumPy nor the standard library reads WebP: Pillow's in
the engine (`engine.pictures.decode_picture`), and Blender's own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import opened_package, optional, parse_json, path_within, read_bytes
from ..scene import Gaussians
from .axes import Up
from .bounds import require_memory, upright
from .picture_size import picture_size
from .transform import logits_of

DecodePicture = Callable[[bytes], NDArray[np.uint8]]
"""Returns the pixels [H, W, 4] of a WebP or PNG picture with exactly its own values; raises `ValueError`."""

META = "meta.json"
MAX_COUNT = 50_000_000
"""Gaussians of a file; more do not fit into pictures of a size that viewers take."""
PALETTE_WIDTH = 64
"""Entries in a row of the palette of harmonics."""
_MAX_PALETTE = 65_536
"""Entries of the palette: labels have 16 bits."""
_LARGEST_IS_W = 252
"""Fourth channel of a rotation whose largest component is w; 253 to 255 are x, y and z."""
_ADVICE = "Copy or export it again."
_MAX_META = 1 << 20
_BYTES_PER_PIXEL = 8
"""A picture that is not compressed at all, and what its container adds."""
_SPARE_PIXELS = 1 << 16
_NUMBERS = [float]
_RANGE = {"mins": (_NUMBERS, float), "maxs": (_NUMBERS, float), "files": [str]}
_BOOK = {"codebook": _NUMBERS, "files": [str]}
_SCHEMA = {
    "version": optional(int),
    "count": optional(int),
    "antialias": optional(bool),
    "model": optional(str),
    "means": {"shape": optional([int]), "mins": _NUMBERS, "maxs": _NUMBERS, "files": [str]},
    "quats": {"files": [str]},
    "scales": (_BOOK, _RANGE),
    "sh0": (_BOOK, _RANGE),
    "shN": optional(({**_BOOK, "bands": int}, _RANGE)),
}

GetBytes = Callable[[str, int], bytes]
"""Returns the content of a part by its name; raises `FormatError` where it has more bytes than the second argument."""


def read_sog(path: Path, decode: DecodePicture, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of a SOG file of version 1 or 2, in the engine's world (Z up).

    Parameters
    ----------
    path : Path
        A zip file (.sog), or ``meta.json`` with its pictures beside it.
    decode : callable
        See `DecodePicture`.
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up, which SOG does not say; by default -Y, as in the files of most programs.

    Raises
    ------
    FormatError
        When the file cannot be read, is not SOG, has another version, misses pictures, or has impossible values.
        Nothing is decoded that is larger than the number of Gaussians explains.
    """
    with _parts(path) as get:
        text = get(META, _MAX_META).decode("utf-8", "replace")
        meta = parse_json(text, _SCHEMA, source=f"{META} of {path}", advice=_ADVICE)
        version = meta.get("version", 1)
        if version not in (1, 2):
            raise FormatError(f"{path} is SOG {version}; versions 1 and 2 are supported. Save it as SOG 2, PLY or SPZ.")
        count = meta.get("count") if version == 2 else (meta["means"].get("shape") or [None])[0]
        if type(count) is not int or not 0 < count <= MAX_COUNT:
            raise FormatError(f"{path} has {count} Gaussians; 1 to {MAX_COUNT} are supported. {_ADVICE}")
        gaussians = _Reader(path, meta, count, get, decode).gaussians()
    return upright(gaussians, up or "-y", path, _ADVICE)


@contextmanager
def _parts(path: Path) -> Iterator[GetBytes]:
    """Yield a function that returns the content of a part by its name, and refuses one that is too large."""
    if path.suffix.lower() == ".json":

        def beside(name: str, most: int) -> bytes:
            file = path if name == META else path_within(path.parent, name)
            return read_bytes(file, max_bytes=most, advice=f"It is a part of {path}. {_ADVICE}")

        yield beside
        return
    with opened_package(path, root=META) as package:

        def inside(name: str, most: int) -> bytes:
            if package.sizes.get(name, most + 1) > most:
                what = "is larger than it can be" if name in package.sizes else "is missing"
                raise FormatError(f"{name[:80]} {what} in {path}. {_ADVICE}")
            with package.reading(name) as stream:
                return stream.read(most)

        yield inside


class _Reader:
    """The parts of a file whose description was read."""

    def __init__(self, path: Path, meta: dict[str, Any], count: int, get: GetBytes, decode: DecodePicture) -> None:
        self._path, self._meta, self._count, self._get, self._decode = path, meta, count, get, decode

    def gaussians(self) -> Gaussians:
        """Return the Gaussians in the axes of the file."""
        # The Gaussians with harmonics of degree 3 (59 numbers), and the largest picture as bytes and as pixels.
        require_memory(self._path, self._count * (4 * (11 + 48) + 40))
        with np.errstate(over="ignore", invalid="ignore"):
            means = self._means()
            log_scales = self._values("scales", self._pixels("scales")[:, :3])
            color = self._pixels("sh0")
            sh = [self._values("sh0", color[:, :3])[:, None]]
            sh += [self._harmonics()] if "shN" in self._meta else []
            return Gaussians(
                means=means,
                log_scales=log_scales,
                quats=_rotations(self._pixels("quats")),
                opacity_logits=self._opacity_logits(color[:, 3]),
                sh=np.concatenate(sh, axis=1, dtype=np.float32),
                antialiased=self._meta.get("antialias", False) or self._meta.get("model") == "antialiased",
            )

    def _damaged(self, what: str) -> FormatError:
        return FormatError(f"{self._path} is a damaged SOG file: {what}. {_ADVICE}")

    def _picture(self, part: str, index: int, most_pixels: int) -> NDArray[np.uint8]:
        files = self._meta[part]["files"]
        if len(files) <= index:
            raise self._damaged(f"`{part}` names {len(files)} pictures instead of {index + 1}")
        data = self._get(files[index], _BYTES_PER_PIXEL * most_pixels)
        size = picture_size(data)
        if size is None:
            raise self._damaged(f"{files[index][:80]} is neither WebP nor PNG")
        if size[0] * size[1] > most_pixels:
            raise self._damaged(f"{files[index][:80]} has {size[0]} x {size[1]} pixels, which are too many")
        try:
            pixels = self._decode(data)
        except ValueError as error:
            raise self._damaged(f"{files[index][:80]} cannot be decoded ({error})") from error
        if pixels.shape != (size[1], size[0], 4):
            raise self._damaged(f"{files[index][:80]} has another size than it states")
        return pixels

    def _pixels(self, part: str, index: int = 0) -> NDArray[np.uint8]:
        """Return the pixels of the Gaussians in a picture, [N, 4]."""
        pixels = self._picture(part, index, 4 * self._count + _SPARE_PIXELS).reshape(-1, 4)
        if len(pixels) < self._count:
            raise self._damaged(f"`{part}` has {len(pixels)} pixels for {self._count} Gaussians")
        return pixels[: self._count]

    def _range(self, part: str, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        low, high = (np.atleast_1d(np.asarray(self._meta[part][end], np.float64)) for end in ("mins", "maxs"))
        if len(low) != width or len(high) != width:
            raise self._damaged(f"`{part}` does not have {width} ranges")
        return low, high

    def _means(self) -> NDArray[np.float32]:
        low, high = self._range("means", 3)
        steps = self._pixels("means")[:, :3].astype(np.uint16)
        steps |= self._pixels("means", 1)[:, :3].astype(np.uint16) << 8
        logs = low + np.where(high == low, 1.0, high - low) * (steps / 65535)
        return (np.sign(logs) * np.expm1(np.abs(logs))).astype(np.float32)

    def _values(self, part: str, steps: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the values of steps [N, channels]: indices into a codebook, or 256 steps in a range each."""
        if "codebook" in self._meta[part]:
            book = np.asarray(self._meta[part]["codebook"], np.float64).astype(np.float32)
            if steps.size and int(steps.max()) >= len(book):
                raise self._damaged(f"the codebook of `{part}` has {len(book)} values, and index {steps.max()} is used")
            return book[steps]
        low, high = self._range(part, 4 if part == "sh0" else 3)
        width = steps.shape[1]
        return (low[:width] + (high - low)[:width] * (steps / 255)).astype(np.float32)

    def _opacity_logits(self, steps: NDArray[np.uint8]) -> NDArray[np.float32]:
        if "codebook" in self._meta["sh0"]:
            return logits_of(steps / 255.0)
        low, high = self._range("sh0", 4)
        return (low[3] + (high[3] - low[3]) * (steps / 255)).astype(np.float32)

    def _harmonics(self) -> NDArray[np.float32]:
        """Return the coefficients of the bands above 0, [N, coefficients, 3]."""
        palette = self._picture("shN", 0, _MAX_PALETTE * 15)
        height, width = palette.shape[:2]
        n_rest = next((n for n in (3, 8, 15) if width == PALETTE_WIDTH * n), 0)
        bands = self._meta["shN"].get("bands")
        if not n_rest or (bands is not None and (bands + 1) ** 2 - 1 != n_rest):
            wanted = "1 to 3" if bands is None else bands
            raise self._damaged(f"the palette of `shN` is {width} pixels wide, for harmonics of degree {wanted}")
        labels = self._pixels("shN", 1)
        rows = labels[:, 0].astype(np.intp) | labels[:, 1].astype(np.intp) << 8
        if int(rows.max()) >= PALETTE_WIDTH * height:
            raise self._damaged(
                f"the palette of `shN` has {PALETTE_WIDTH * height} entries, and index {rows.max()} is used"
            )
        entries = palette[..., :3].reshape(-1, 3)
        if "codebook" in self._meta["shN"]:
            values = self._values("shN", entries)
        else:
            low, high = self._range("shN", 1)
            values = (low + (high - low) * (entries / 255)).astype(np.float32)
        return values.reshape(-1, n_rest, 3)[rows]


def _rotations(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return quaternions wxyz of unit length, [N, 4]; the identity where no component is said to be the largest."""
    largest = pixels[:, 3].astype(int) - _LARGEST_IS_W
    known = largest >= 0
    three = (pixels[:, :3] / np.float32(255) * 2 - 1) * np.float32(0.5**0.5)
    others = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[np.maximum(largest, 0)]
    quats = np.empty((len(pixels), 4), np.float32)
    np.put_along_axis(quats, others, three.astype(np.float32), axis=1)
    rest = np.sqrt(np.maximum(0, 1 - (three * three).sum(axis=1))).astype(np.float32)
    np.put_along_axis(quats, np.maximum(largest, 0)[:, None], rest[:, None], axis=1)
    quats[~known] = (1, 0, 0, 0)
    return quats
