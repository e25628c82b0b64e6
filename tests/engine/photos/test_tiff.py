"""TIFF files of every layout are read as a second decoder reads them, or refused with a sentence; other formats too."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from engine.core.errors import PhotoError
from engine.photos.loading import load_pixels

from .opencv import read_picture, write_picture
from .test_pixels import corners

HEIGHT, WIDTH = 48, 64
_COLOURS: dict[str, dict[str, Any]] = {
    "gray": {"photometric": "minisblack"},
    "inverted": {"photometric": "miniswhite"},
    "gray and alpha": {"photometric": "minisblack", "extrasamples": ["unassalpha"]},
    "rgb": {"photometric": "rgb"},
    "rgba": {"photometric": "rgb", "extrasamples": ["unassalpha"]},
    "premultiplied": {"photometric": "rgb", "extrasamples": ["assocalpha"]},
    "unspecified": {"photometric": "rgb", "extrasamples": ["unspecified"]},
    "cmyk": {"photometric": "separated"},
}
_TYPES: dict[str, type] = {
    "1": np.bool_, "8": np.uint8, "16": np.uint16, "32": np.uint32, "signed 8": np.int8, "signed 16": np.int16,
    "half": np.float16, "float": np.float32, "double": np.float64,
}  # fmt: skip
READ = {
    **{("1", colours): "read" for colours in ("gray", "inverted")},
    **{("8", colours): "read" for colours in _COLOURS},
    **{("16", colours): "read" for colours in _COLOURS if colours not in ("inverted", "gray and alpha")},
}
"""What must be read; all other combinations must be refused."""


def picture() -> NDArray[np.float64]:
    """Return colours from 0 to 1 whose rows, columns and channels all differ."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.stack([x / WIDTH, y / HEIGHT, 0.1 + 0.8 * ((x // 8 + y // 8) % 2)], axis=-1)
    pixels[5:20, 30:50] = (1.0, 0.2, 0.0)
    return pixels


def samples(colours: str, kind: str) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return what a file stores and the colours that it means."""
    rgb = picture()
    gray, full = rgb.mean(axis=2, keepdims=True), np.ones((HEIGHT, WIDTH, 1))
    shown = gray.repeat(3, axis=2) if colours in ("gray", "inverted", "gray and alpha") else rgb
    stored = {
        "gray": gray, "inverted": 1.0 - gray, "gray and alpha": np.dstack([gray, full]), "rgb": rgb,
        "cmyk": np.dstack([1.0 - rgb, 0.0 * full]),
    }.get(colours, np.dstack([rgb, full]))  # fmt: skip
    dtype = np.dtype(_TYPES[kind])
    if dtype == np.bool_:
        return (stored > 0.5)[..., 0], ((gray >= 0.5 if colours == "inverted" else gray > 0.5) * 1.0).repeat(3, axis=2)
    values = stored.astype(dtype) if dtype.kind == "f" else np.rint(stored * np.iinfo(dtype).max).astype(dtype)
    return (values[..., 0] if values.shape[2] == 1 else values), shown


def layouts(colours: str, kind: str) -> Iterator[dict[str, Any]]:
    """Yield the options of tifffile for all planes, compressions, byte orders, tiles and predictors that it writes."""
    planes = ("contig",) if colours in ("gray", "inverted") else ("contig", "separate")
    choices = itertools.product(planes, (None, "zlib", "lzma"), (False, True), "<>", (None, (32, 32)))
    for plane, compression, predictor, order, tile in choices:
        if predictor and (compression != "zlib" or kind in ("1", "half", "float", "double")):
            continue
        options = {**_COLOURS[colours], "compression": compression, "byteorder": order, "tile": tile, "metadata": None}
        if predictor:
            options["predictor"] = True
        if len(planes) > 1:
            options["planarconfig"] = plane
        if tile is None:
            options["rowsperstrip"] = 16
        yield options


@pytest.mark.parametrize("kind", _TYPES)
@pytest.mark.parametrize("colours", _COLOURS)
def test_every_layout_is_read_right_or_refused(tmp_path: Path, colours: str, kind: str) -> None:
    if kind == "1" and colours not in ("gray", "inverted"):
        pytest.skip("one bit has one channel")
    stored, shown = samples(colours, kind)
    path = tmp_path / "a.tif"
    n_read = 0
    for options in layouts(colours, kind):
        separate = options.get("planarconfig") == "separate"
        tifffile.imwrite(path, np.moveaxis(stored, -1, 0) if separate else stored, **options)
        # The second decoder agrees with what was meant to be written.
        assert (
            np.asarray(tifffile.imread(path)).reshape(-1)[:5]
            == (np.moveaxis(stored, -1, 0) if separate else stored).reshape(-1)[:5]
        ).all()
        try:
            pixels = load_pixels(path)
        except PhotoError as error:
            must_be_read = (kind, colours) in READ and not (colours == "gray and alpha" and separate)
            assert not must_be_read, (options, str(error))
            assert "damaged" not in str(error) or "not read" in str(error), (options, str(error))
            assert str(error).startswith("a.tif ") and "8 or 16 bits" in str(error)
            continue
        n_read += 1
        # Half a level of rounding, and one for the upper byte that Pillow keeps of 16 bits.
        assert np.abs(pixels / 255.0 - shown).max() <= 1.6 / 255.0, options
    assert (n_read > 0) == ((kind, colours) in READ)


@pytest.mark.parametrize(
    "compression", ["tiff_lzw", "packbits", "tiff_adobe_deflate", "tiff_deflate", "zstd", "jpeg", "group4"]
)
@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "CMYK", "LAB"])
def test_other_compressions_are_read_as_by_opencv(tmp_path: Path, mode: str, compression: str) -> None:
    picture = Image.fromarray(corners()).convert("RGB")
    source = picture.convert(mode) if mode != "LAB" else Image.fromarray(corners(), "LAB")
    path = tmp_path / "a.tif"
    try:
        source.save(path, compression=compression)
    except (OSError, ValueError, KeyError, RuntimeError):
        pytest.skip(f"Pillow does not write {mode} with {compression}")
    pixels = load_pixels(path).astype(int)
    if mode in ("CMYK", "LAB") or compression == "zstd":
        # OpenCV does not read these: the same picture without compression is the comparison.
        source.save(tmp_path / "plain.tif")
        expected = load_pixels(tmp_path / "plain.tif")
    else:
        expected = cv2.cvtColor(read_picture(path), cv2.COLOR_BGR2RGB)
    # JPEG at Pillow's quality of 75, upsampled by two decoders.
    assert np.abs(pixels - expected).mean() < (4 if compression == "jpeg" else 0.01)


@pytest.mark.parametrize("bits", [2, 4, 12])
def test_packed_bits_are_read_right_or_refused(tmp_path: Path, bits: int) -> None:
    levels = np.tile(np.arange(WIDTH) % (1 << bits), (HEIGHT, 1)).astype(np.uint16)
    stream = "".join(f"{value:0{bits}b}" for value in levels.reshape(-1))
    data = int(stream, 2).to_bytes(len(stream) // 8, "big")
    tags = [
        (256, WIDTH),
        (257, HEIGHT),
        (258, bits),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, HEIGHT),
        (279, len(data)),
    ]
    entries = b"".join(tag.to_bytes(2, "little") + b"\4\0\1\0\0\0" + value.to_bytes(4, "little") for tag, value in tags)
    start = (8 + len(data)).to_bytes(4, "little")
    (tmp_path / "a.tif").write_bytes(b"II*\0" + start + data + len(tags).to_bytes(2, "little") + entries + bytes(4))
    if bits == 12:
        with pytest.raises(
            PhotoError, match=r"^a\.tif has 12 bits per sample\. Save it again as RGB with 8 or 16 bits"
        ):
            load_pixels(tmp_path / "a.tif")
    else:
        assert np.abs(load_pixels(tmp_path / "a.tif")[..., 0] - levels * (255 / ((1 << bits) - 1))).max() <= 0.5


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("palette.png", lambda: Image.fromarray(corners()).convert("P")),
        ("palette.tif", lambda: Image.fromarray(corners()).convert("P")),
        ("bits.png", lambda: Image.fromarray(corners()).convert("1")),
        ("gray.jpg", lambda: Image.fromarray(corners()).convert("L")),
        ("colour.jpg", lambda: Image.fromarray(corners())),
        ("colour.webp", lambda: Image.fromarray(corners())),
        ("interlaced.png", lambda: Image.fromarray(corners())),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_other_formats_are_read_as_by_opencv(tmp_path: Path, name: str, make: Any) -> None:
    make().save(tmp_path / name, **({"quality": 95} if name.endswith(("jpg", "webp")) else {}))
    expected = cv2.cvtColor(read_picture(tmp_path / name), cv2.COLOR_BGR2RGB)
    # Two decoders of JPEG round differently where chroma is upsampled.
    assert np.abs(load_pixels(tmp_path / name).astype(int) - expected).mean() < 1


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bits_of_png_are_read_as_by_opencv(tmp_path: Path, channels: int) -> None:
    values = np.random.default_rng(0).integers(0, 65536, (HEIGHT, WIDTH, channels), dtype=np.uint16)
    if channels == 4:
        values[..., 3] = 65535
    write_picture(tmp_path / "a.png", values)
    read = read_picture(tmp_path / "a.png", cv2.IMREAD_UNCHANGED).reshape(HEIGHT, WIDTH, channels)
    expected = np.broadcast_to(read[..., :3][..., ::-1], (HEIGHT, WIDTH, 3)) / 257.0
    assert np.abs(load_pixels(tmp_path / "a.png") - expected).max() <= 1.0


def test_jpeg_of_twelve_bits_is_refused_with_its_cause(tmp_path: Path) -> None:
    Image.fromarray(corners()).save(tmp_path / "a.jpg")
    data = bytearray((tmp_path / "a.jpg").read_bytes())
    frame = data.index(b"\xff\xc0")
    data[frame + 4] = 12
    (tmp_path / "a.jpg").write_bytes(data)
    with pytest.raises(PhotoError, match=r"^a\.jpg has 12 bits per sample, and JPEG files are read with 8\."):
        load_pixels(tmp_path / "a.jpg")
