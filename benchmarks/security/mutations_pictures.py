"""Mutations of pictures: sizes in headers, lengths of parts, and EXIF with every type of value."""

from __future__ import annotations

import io
import random
import struct
import zlib
from typing import Any

_TAGS = (0x0100, 0x0101, 0x0102, 0x0103, 0x0106, 0x010F, 0x0110, 0x0111, 0x0112, 0x0115, 0x0117, 0x011A, 0x8769, 0x8825)
_CAMERA_TAGS = (0x829A, 0x829D, 0x8827, 0x920A, 0xA405, 0xA002, 0xA003, 0xA20E, 0xA210, 0x927C, 0x9286, 0xA005)
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8}
"""Bytes of a value by TIFF type; 5 and 10 are fractions, 11 and 12 floats."""
_NUMBERS = (0, 1, 2, 3, 6, 8, 9, 50, 100, 0xFFFF, 1 << 31, 0xFFFFFFFF, 0x7F800000, 0x7FC00000, 0x7FF00000)


def _exif(rng: random.Random) -> bytes:
    """Return a TIFF directory with random tags, types, counts and values, and one with the camera's tags."""
    order = rng.choice("<>")
    directories = []
    # The second directory begins where the first one with its values can end.
    start_of_second = 1024
    for start, tags in ((8, _TAGS), (start_of_second, _CAMERA_TAGS)):
        entries, values = b"", b""
        # Often all of them: a reader may use a value only beside another.
        chosen = rng.sample(tags, rng.choice((len(tags), len(tags), rng.randrange(1, len(tags)))))
        for tag in chosen:
            kind = rng.choice((2, 3, 4, 5, 5, 5, 7, 10, 10, 11, 12, rng.randrange(20)))
            count = rng.choice((1, 1, 1, 1, 0, 2, 20, 1000, 0xFFFFFFFF))
            size = _SIZES.get(kind, 4) * count
            value = b"".join(struct.pack(order + "I", rng.choice(_NUMBERS)) for _ in range(2))
            if kind == 12:
                value = struct.pack(
                    order + "d", rng.choice((1e200, -1e200, 1e-300, float("nan"), float("inf"), 0.0, 5.0))
                )
            if tag == 0x8769 and rng.random() < 0.8:
                kind, count, value = (
                    4,
                    1,
                    struct.pack(order + "I", rng.choice((start_of_second, start_of_second, 8, 0, 9999999))),
                )
            elif size > 4:
                offset = start + 2 + 12 * len(chosen) + 4 + len(values)
                values += value
                value = struct.pack(order + "I", offset)
            entries += struct.pack(order + "HHI", tag, kind, count) + value[:4]
        following = struct.pack(order + "I", rng.choice((0, 0, 0, 8, 1 << 30)))
        directories.append(
            struct.pack(order + "H", rng.choice((len(chosen), len(chosen), 0xFFFF))) + entries + following + values
        )
    mark = b"II*\0" if order == "<" else b"MM\0*"
    first = mark + struct.pack(order + "I", rng.choice((8, 8, 8, 8, 0, 1 << 31))) + directories[0]
    return first.ljust(start_of_second, b"\0")[:start_of_second] + directories[1]


def _segments(data: bytes) -> list[tuple[int, bytes]]:
    """Return marker and content of the segments of a JPEG; that of the first scan is the rest of the file."""
    found, at = [], 2
    while data[at + 1] != 0xDA:
        length = struct.unpack_from(">H", data, at + 2)[0]
        found.append((data[at + 1], data[at + 4 : at + 2 + length]))
        at += 2 + length
    return [*found, (0xDA, data[at:])]


def _jpeg(segments: list[tuple[int, bytes]]) -> bytes:
    head = b"".join(
        bytes((0xFF, marker)) + struct.pack(">H", (len(content) + 2) & 0xFFFF) + content
        for marker, content in segments
        if marker != 0xDA
    )
    return b"\xff\xd8" + head + b"".join(content for marker, content in segments if marker == 0xDA)


def _with_exif(data: bytes, rng: random.Random) -> bytes:
    segments = [(marker, content) for marker, content in _segments(data) if marker != 0xE1]
    return _jpeg([(0xE1, b"Exif\0\0" + _exif(rng)), *segments])


def _with_another_frame(data: bytes, rng: random.Random) -> bytes:
    """Change precision, size or components in the frame's header."""
    segments = _segments(data)
    at = next(number for number, (marker, _) in enumerate(segments) if 0xC0 <= marker <= 0xC2)
    marker, content = segments[at]
    changed = bytearray(content)
    offset = rng.choice((0, 1, 3, 5, 6, 7, 8))
    if offset in (1, 3):
        struct.pack_into(">H", changed, offset, rng.choice((0, 1, 127, 1000, 20_000, 65_500, 0xFFFF)))
    else:
        changed[offset] = rng.choice((0, 1, 2, 3, 4, 8, 12, 0x11, 0x22, 0x44, 0xFF))
    segments[at] = rng.choice((marker, marker, 0xC2, 0xC9, 0xC3)), bytes(changed)
    return _jpeg(segments)


def _with_other_segments(data: bytes, rng: random.Random) -> bytes:
    segments = _segments(data)
    at = rng.randrange(len(segments))
    match rng.randrange(4):
        case 0:
            del segments[at]
        case 1:
            segments.insert(at, rng.choice(segments))
        case 2:
            marker, content = segments[at]
            segments[at] = marker, content[: rng.randrange(len(content) + 1)]
        case _:
            names = (
                b"ICC_PROFILE\0\1\1",
                b"Adobe\0",
                b"http://ns.adobe.com/xap/1.0/\0",
                b"MPF\0",
                b"Photoshop 3.0\0",
                b"JFIF\0",
            )
            segments.insert(
                0,
                (rng.choice((0xE0, 0xE1, 0xE2, 0xED, 0xEE)), rng.choice(names) + rng.randbytes(rng.choice((0, 4, 90)))),
            )
    return _jpeg(segments)


def _with_more_scans(data: bytes, rng: random.Random) -> bytes:
    """Repeat the compressed data, as if the picture had many scans."""
    segments = _segments(data)
    scan = segments[-1][1].removesuffix(b"\xff\xd9")
    return _jpeg([*segments[:-1], (0xDA, scan * rng.choice((2, 20, 200)) + b"\xff\xd9")])


JPEG = (
    _with_exif,
    _with_exif,
    _with_exif,
    _with_another_frame,
    _with_another_frame,
    _with_other_segments,
    _with_more_scans,
)
"""Each takes the bytes of a JPEG and a `Random`."""


def _png_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while at < len(data):
        length = struct.unpack_from(">I", data, at)[0]
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _png(chunks: list[tuple[bytes, bytes]]) -> bytes:
    parts = [
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _with_another_png_header(data: bytes, rng: random.Random) -> bytes:
    """Change size, depth, type of colour, compression, filter or interlacing, with the right checksum."""
    chunks = _png_chunks(data)
    changed = bytearray(chunks[0][1])
    offset = rng.choice((0, 4, 0, 4, 8, 9, 10, 11, 12))
    if offset < 8:
        struct.pack_into(">I", changed, offset, rng.choice((0, 1, 1000, 19_900, 100_000, 1 << 31, 0xFFFFFFFF, 3, 129)))
    else:
        changed[offset] = rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 0xFF))
    return _png([(chunks[0][0], bytes(changed)), *chunks[1:]])


def _with_other_chunks(data: bytes, rng: random.Random) -> bytes:
    chunks = _png_chunks(data)
    at = rng.randrange(1, len(chunks))
    packed = zlib.compress(b"x" * rng.choice((1, 5_000_000)))
    more = (
        (b"eXIf", _exif(rng)), (b"tEXt", b"a\0" + b"x" * 1000), (b"zTXt", b"a\0\0" + packed),
        (b"iCCP", b"a\0\0" + packed),
        (b"iTXt", b"a\0\1\0\0\0" + packed), (b"tRNS", rng.randbytes(6)), (b"PLTE", rng.randbytes(5)),
        (b"gAMA", b"\0" * 4),
        (b"acTL", struct.pack(">II", 99999, 0)), (b"fcTL", rng.randbytes(26)), (b"IDAT", rng.randbytes(20)),
        (b"XXXX", b""),
        (b"IHDR", rng.randbytes(13)), (b"iCCP", rng.randbytes(30)), (b"pHYs", rng.randbytes(9)), (b"sRGB", b"\xff"),
    )  # fmt: skip
    match rng.randrange(4):
        case 0:
            del chunks[at]
        case 1:
            chunks[at] = chunks[at][0], chunks[at][1][: rng.randrange(len(chunks[at][1]) + 1)]
        case _:
            chunks.insert(at, rng.choice(more))
    return _png(chunks)


def _with_another_chunk_length(data: bytes, rng: random.Random) -> bytes:
    at, starts = 8, []
    while at < len(data):
        starts.append(at)
        at += 12 + int(struct.unpack_from(">I", data, at)[0])
    start = rng.choice(starts)
    number = rng.choice((0, 1, 1 << 31, 0xFFFFFFFF, 1 << 20))
    return data[:start] + struct.pack(">I", number) + data[start + 4 :]


PNG = (
    _with_another_png_header,
    _with_another_png_header,
    _with_other_chunks,
    _with_other_chunks,
    _with_another_chunk_length,
)
"""Each takes the bytes of a PNG and a `Random`."""


def png_bomb(data: bytes, rng: random.Random, size: int) -> bytes:
    """Return a PNG of one colour whose packed size is at most about `size` bytes: 2 to 144 million pixels."""
    side = rng.choice((1500, 1500, 4000, 12_000))
    depth, colours = rng.choice(((1, 0), (8, 0), (8, 2), (8, 6), (16, 0), (8, 3)))
    channels = {0: 1, 2: 3, 3: 1, 6: 4}[colours]
    row = b"\0" + bytes(-(-side * depth * channels // 8))
    packer = zlib.compressobj(1)
    packed = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    palette = [(b"PLTE", bytes(768))] if colours == 3 else []
    header = struct.pack(">IIBBBBB", side, side, depth, colours, 0, 0, 0)
    return _png([(b"IHDR", header), *palette, (b"IDAT", packed), (b"IEND", b"")])


def large_picture(kind: str, data: bytes, rng: random.Random, size: int) -> bytes:
    """Return a picture of 2 to 81 million pixels, cut at `size` bytes; `kind` is Pillow's name of the format."""
    from PIL import Image

    # The encoder of HEIC takes a second for a million pixels.
    side = rng.choice((1500, 1500, 4000, 9000)) if kind != "HEIF" else 1500
    mode = rng.choice(("RGB", "L", "CMYK")) if kind in ("TIFF", "JPEG") else "RGB"
    stream = io.BytesIO()
    options: dict[str, dict[str, Any]] = {
        "TIFF": {"compression": rng.choice(("tiff_lzw", "tiff_adobe_deflate"))},
        "JPEG": {"progressive": rng.random() < 0.5},
    }
    # Not noise: a larger picture fits into the same bytes.
    Image.linear_gradient("L").resize((side, side)).convert(mode).save(
        stream, kind, **options.get(kind, {"quality": 10})
    )
    return stream.getvalue()[:size]


def _with_another_entry(data: bytes, rng: random.Random) -> bytes:
    """Change tag, type, count or value of an entry of the first directory."""
    order = "<" if data[:2] == b"II" else ">"
    start = struct.unpack_from(order + "I", data, 4)[0]
    count = struct.unpack_from(order + "H", data, start)[0]
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3))):
        entry = start + 2 + 12 * rng.randrange(count)
        match rng.randrange(4):
            case 0:
                struct.pack_into(order + "H", changed, entry, rng.choice((*_TAGS, *_CAMERA_TAGS)))
            case 1:
                struct.pack_into(order + "H", changed, entry + 2, rng.randrange(20))
            case 2:
                struct.pack_into(order + "I", changed, entry + 4, rng.choice((0, 2, 1000, 1 << 30, 0xFFFFFFFF)))
            case _:
                struct.pack_into(
                    order + "I", changed, entry + 8, rng.choice((*_NUMBERS, 5, 7, 32_773, 34_712, start, 40_000))
                )
    return bytes(changed)


def _with_another_directory(data: bytes, rng: random.Random) -> bytes:
    """Point to a directory of EXIF tags that is appended, from the header or from the end of the first directory."""
    order = "<" if data[:2] == b"II" else ">"
    start = struct.unpack_from(order + "I", data, 4)[0]
    count = struct.unpack_from(order + "H", data, start)[0]
    changed = bytearray(data + _exif(rng))
    at = rng.choice((4, start + 2 + 12 * count))
    struct.pack_into(order + "I", changed, at, rng.choice((len(data) + 8, start, 0, len(data))))
    return bytes(changed)


TIFF = (_with_another_entry, _with_another_entry, _with_another_entry, _with_another_directory)
"""Each takes the bytes of a TIFF and a `Random`."""


def _with_another_riff_part(data: bytes, rng: random.Random) -> bytes:
    exif = _exif(rng)
    parts = (
        b"EXIF" + struct.pack("<I", len(exif)) + exif, b"ALPH" + struct.pack("<I", 0xFFFFFFFF),
        b"VP8X" + rng.randbytes(14),
        b"ANIM" + rng.randbytes(10), b"ICCP" + struct.pack("<I", 8) + rng.randbytes(8),
    )  # fmt: skip
    at = rng.choice((12, len(data)))
    body = data[8:at] + rng.choice(parts) + data[at:]
    return b"RIFF" + struct.pack("<I", rng.choice((len(body), len(body), 0, 0xFFFFFFFF))) + body


def _with_another_webp_header(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 2))):
        changed[rng.randrange(12, min(40, len(data)))] = rng.randrange(256)
    return bytes(changed)


WEBP = (_with_another_riff_part, _with_another_webp_header)
"""Each takes the bytes of a WebP and a `Random`."""


_HOLDING = {b"meta": 12, b"iprp": 8, b"ipco": 8, b"iinf": 14}
"""Boxes that hold boxes, and the bytes before these."""


def _boxes(data: bytes, start: int, end: int) -> list[tuple[bytes, int, int]]:
    """Return type, start and end of the boxes of a HEIC file, outer ones first."""
    found = []
    while start + 8 <= end:
        size, kind = int.from_bytes(data[start : start + 4], "big"), data[start + 4 : start + 8]
        if not 8 <= size <= end - start:
            break
        found.append((kind, start, start + size))
        if kind in _HOLDING:
            found += _boxes(data, start + _HOLDING[kind], start + size)
        start += size
    return found


def _with_another_box(data: bytes, rng: random.Random) -> bytes:
    """Change the size, the type or a number of a box, or repeat it; often one of those that say how to decode."""
    boxes = _boxes(data, 0, len(data))
    telling = [
        box for box in boxes if box[0] in (b"ispe", b"iloc", b"hvcC", b"ipma", b"irot", b"clap", b"pixi", b"colr")
    ]
    kind, start, end = rng.choice(telling if telling and rng.random() < 0.7 else boxes)
    changed = bytearray(data)
    match rng.randrange(4):
        case 0:
            struct.pack_into(">I", changed, start, rng.choice((0, 1, 7, 8, 9, end - start + 4, 0x7FFFFFFF, 0xFFFFFFFF)))
        case 1:
            changed[start + 4 : start + 8] = rng.choice(
                (b"free", b"ispe", b"irot", b"imir", b"grid", b"clap", b"auxC", kind[::-1])
            )
        case 2:
            return data[:start] + data[start:end] * rng.choice((0, 2, 100, 2000)) + data[end:]
        case _:
            at = rng.randrange(start + 8, end) if end > start + 8 else start
            number = struct.pack(">I", rng.choice((*_NUMBERS, 64, 512, 32_768, 40_000, 65_536)))
            changed[at : at + 4] = number[: max(1, min(4, end - at))]
    return bytes(changed)


def _with_other_heic_data(data: bytes, rng: random.Random) -> bytes:
    """Change bytes of the compressed picture, which the decoder reads."""
    place = next((start + 8 for kind, start, _ in _boxes(data, 0, len(data)) if kind == b"mdat"), 0)
    changed = bytearray(data)
    for _ in range(rng.choice((1, 4, 30))):
        changed[rng.randrange(place, len(data))] = rng.randrange(256)
    return bytes(changed)


HEIC = (_with_another_box, _with_another_box, _with_another_box, _with_other_heic_data)
"""Each takes the bytes of a HEIC file and a `Random`."""
