"""Pixels of a HEIC photo, decoded by FFmpeg: the same pixels as libheif's, in two thirds of its time.

libheif reads the container and says what the picture is made of. FFmpeg's decoder of HEVC is faster than libde265, but
gives tiles and not the picture. Only what phones write is decoded here: one picture of 8 bits in 4:2:0, whole or in
tiles. Everything else, and every doubt, is left to libheif, which decides what is damaged.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

_LOG = logging.getLogger(__name__)

_FULL_RANGE = 2
"""FFmpeg's number for levels from 0 to 255."""
_BT601 = frozenset({2, 5, 6})
"""Numbers of ITU-T H.273 for the matrix of JPEG, which phones use, also where a file states none."""
_PIXEL_FORMATS = frozenset({"yuv420p", "yuvj420p"})
_TURNS = ("irot", "imir")
_GREEN = 8 if sys.byteorder == "little" else 16
"""Where the green of a pixel begins in its number, in bits."""
_MAX_STEP, _MIN_STEP = 3.0, 12.0
"""Largest difference across a seam: so many times that beside it, and so many levels more. Tiles in another order than
their numbers differ more, as long as their borders show anything."""


@dataclass(frozen=True)
class _Layout:
    """Tiles of a picture as it is stored, before `turns`; one tile where it is whole."""

    columns: int
    rows: int
    tile: tuple[int, int]
    turns: tuple[tuple[str, int], ...]
    item: int
    """Number of the picture in its file."""


def load_heic(image: Image.Image) -> Image.Image:
    """Return a HEIC picture with its pixels decoded.

    Parameters
    ----------
    image : Image
        As pillow-heif opens it, before its pixels are loaded.

    Returns
    -------
    Image
        Upright, as libheif decodes it, to one level of 255; with the same ``info`` and ``format``. Of mode RGB or RGBX.

    Raises
    ------
    EOFError
        When the file is cut short, which libheif takes for a picture with gaps.
    """
    pixels = _pixels_of(image)
    if pixels is None:
        image.load()
        return image
    # The memory of the array becomes that of the picture.
    loaded = Image.frombuffer("RGBX", pixels.shape[1::-1], pixels, "raw", "RGBX", 0, 1)
    loaded.info, loaded.format = image.info, image.format
    return loaded


def _pixels_of(image: Image.Image) -> NDArray[np.uint32] | None:
    """Return the upright pixels [H, W], red in the first byte of each; None for pictures that libheif must decode."""
    layout = _layout_of(image)
    if layout is None:
        return None
    try:
        import av
    # Damaged, or missing in an environment that was set up before its list of packages changed: libheif is slower.
    except (ImportError, OSError):
        return None
    pixels = np.empty(image.size[::-1], np.uint32)
    stored = pixels
    for kind, value in reversed(layout.turns):
        stored = np.rot90(stored, -value // 90) if kind == "irot" else np.flip(stored, 1 if value == 1 else 0)
    try:
        is_whole = _fill(stored, image.fp, layout, av)
    # FFmpeg refuses what is damaged; libheif says whether it is.
    except (av.FFmpegError, ValueError) as error:
        _LOG.info("FFmpeg does not decode a HEIC picture: %r", error)
        return None
    return pixels if is_whole and _fits_together(stored, layout) else None


def _layout_of(image: Any) -> _Layout | None:
    """Return what the picture is made of; None where it is not of the common form."""
    info = image.info
    numbers = info.get("nclx_profile")
    if image.mode != "RGB" or image.n_frames != 1 or info.get("bit_depth") != 8 or info.get("chroma") != 420:
        return None
    if numbers is not None and not (numbers["full_range_flag"] and numbers["matrix_coefficients"] in _BT601):
        return None
    # pillow-heif has no public name for these two.
    picture = image._heif_file[image.tell()]._c_image
    turns = tuple((turn[0], turn[1]) for turn in picture.transformations if turn[0] in _TURNS)
    if len(turns) != len(picture.transformations):
        return None
    tiling = info.get("tiling")
    if tiling is None:
        columns, rows, tile = 1, 1, image.size
    else:
        columns, rows = tiling["num_columns"], tiling["num_rows"]
        tile = tiling["tile_width"], tiling["tile_height"]
    # libheif states the layout of the upright picture.
    if sum(value // 90 for kind, value in turns if kind == "irot") % 2:
        columns, rows, tile = rows, columns, tile[::-1]
    return _Layout(columns, rows, tile, turns, picture.item_id)


def _fill(stored: NDArray[np.uint32], file: Any, layout: _Layout, av: Any) -> bool:
    """Write all tiles into the picture; returns False when it is not clear which they are."""
    wide, high = layout.tile
    n_tiles = layout.columns * layout.rows
    file.seek(0)
    with av.open(file, format="mov") as container:
        streams = _tiles_among(container, layout, av)
        if len(streams) != n_tiles:
            return False
        places = {stream.index: number for number, stream in enumerate(streams)}
        found = set()
        for frame in _frames_of(_packets_of(container, streams), places, av):
            if not _is_usual(frame, layout.tile) or frame.pts in found:
                return False
            found.add(frame.pts)
            row, column = divmod(frame.pts, layout.columns)
            place = stored[row * high : (row + 1) * high, column * wide : (column + 1) * wide]
            place[:] = _rgb_of(frame)[: place.shape[0], : place.shape[1]]
    return found == set(range(n_tiles))


def _tiles_among(container: Any, layout: _Layout, av: Any) -> list[Any]:
    """Return the streams with the tiles, in the order of their numbers in the file.

    Thumbnails and pictures of depth and brightness have other sizes, numbers or colours.
    """
    streams = container.streams.video
    if layout.columns * layout.rows == 1:
        return [stream for stream in streams if stream.id == layout.item]
    dependent = av.stream.Disposition.dependent
    tiles = [
        stream
        for stream in streams
        if stream.disposition & dependent
        and (stream.width, stream.height) == layout.tile
        and stream.codec_context.pix_fmt in _PIXEL_FORMATS
    ]
    return sorted(tiles, key=lambda stream: int(stream.id))


def _packets_of(container: Any, streams: list[Any]) -> Iterator[Any]:
    """Yield the encoded tiles; raises `EOFError` when the file ends before the last one."""
    n_packets = 0
    for packet in container.demux(streams):
        if packet.size:
            if packet.is_corrupt:
                break
            n_packets += 1
            yield packet
    if n_packets < len(streams):
        raise EOFError(f"{n_packets} of {len(streams)} tiles are in the file")


def _frames_of(packets: Iterator[Any], places: dict[int, int], av: Any) -> Iterator[Any]:
    """Yield the decoded tiles, each with its place as its time.

    Tiles with equal parameters share a decoder: to start one for each would take most of the time.
    """
    decoders: dict[bytes, Any] = {}
    for packet in packets:
        parameters = bytes(packet.stream.codec_context.extradata or b"")
        if parameters not in decoders:
            decoder = decoders[parameters] = av.CodecContext.create("hevc", "r")
            decoder.extradata = parameters
            # Photos are decoded on all cores already.
            decoder.thread_count = 1
            decoder.options = {"err_detect": "explode"}
        packet.pts = packet.dts = places[packet.stream.index]
        yield from decoders[parameters].decode(packet)
    for decoder in decoders.values():
        yield from decoder.decode(None)


def _is_usual(frame: Any, size: tuple[int, int]) -> bool:
    return (
        not frame.is_corrupt
        and frame.pts is not None
        and (frame.width, frame.height) == size
        and frame.format.name in _PIXEL_FORMATS
        and int(frame.color_range) == _FULL_RANGE
        and int(frame.colorspace) in _BT601
    )


def _rgb_of(frame: Any) -> NDArray[np.uint32]:
    """Return the pixels of a frame; each value of colour stands for four of them, as in libheif."""
    import cv2  # 400 MB of addresses, which other photos do not need

    luma, blue, red = (
        np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]
        for plane in frame.planes
    )
    height, width = luma.shape
    size = 2 * blue.shape[1], 2 * blue.shape[0]
    colours = [cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST)[:height, :width] for plane in (red, blue)]
    pixels = cv2.cvtColor(cv2.merge((luma, *colours)), cv2.COLOR_YCrCb2RGB, dstCn=4)
    return pixels.view(np.uint32)[..., 0]


def _fits_together(stored: NDArray[np.uint32], layout: _Layout) -> bool:
    """Return whether no seam between two tiles is a step: a file may number its tiles in another order."""
    wide, high = layout.tile
    for picture, step, length in ((stored, high, wide), (stored.T, wide, high)):
        starts = np.arange(0, picture.shape[1], length)
        counts = np.diff([*starts, picture.shape[1]])
        for seam in range(step, len(picture) - 1, step):
            green = (picture[seam - 2 : seam + 2] >> _GREEN).astype(np.uint8).astype(np.int16)
            sums = np.add.reduceat(np.abs(np.diff(green, axis=0)), starts, axis=1, dtype=np.int64)
            before, across, behind = sums / counts
            if (across > _MAX_STEP * (before + behind) / 2 + _MIN_STEP).any():
                return False
    return True
