"""Mutations of PLY, GLB, gzipped tar and ONNX files."""

from __future__ import annotations

import gzip
import random
import re
import struct

from .mutations_json import JSON

_TYPES = (b"float", b"double", b"uchar", b"int", b"short", b"list uchar int", b"half", b"float64", b"", b"list")
_LINES = (
    b"element vertex 1000000000000", b"element vertex -1", b"element vertex 0", b"element vertex 1.5",
    b"element vertex",
    b"element vertex 9999999999999999999999", b"element face 5", b"property list uchar int vertex_indices", b"property",
    b"element chunk 1", b"format ascii 1.0", b"format binary_big_endian 1.0", b"format", b"end_header",
    b"comment \xff\xfe",
    b"comment " + b"x" * 100_000, b"property float x", b"property list int int x", b"obj_info x", b"", b"\0",
    b"element a 3",
    b"element a 1000000000000", b"property float f_rest_45", b"element vertex \xd9\xa1",
    b"property float " + b"y" * 5000,
)  # fmt: skip


def _with_another_header_line(data: bytes, rng: random.Random) -> bytes:
    header, mark, body = data.partition(b"end_header\n")
    lines = header.split(b"\n")
    at = rng.randrange(1, len(lines))
    match rng.randrange(6):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, rng.choice(_LINES))
        case 2:
            lines[at] = rng.choice(_LINES)
        case 3:
            lines.insert(at, rng.choice(lines))
        case 4:
            words = lines[at].split()
            lines[at] = b" ".join([words[0], rng.choice(_TYPES), *words[2:]])
        case _:
            properties = [b"property float p%d" % number for number in range(rng.choice((10, 1500)))]
            lines[at:at] = [b"element other %d" % rng.choice((0, 1, 10**9)), *properties]
    return b"\n".join(lines) + mark + body


def _with_other_rows(data: bytes, rng: random.Random) -> bytes:
    header, mark, body = data.partition(b"end_header\n")
    changed = bytearray(body)
    numbers = (0x7FC00000, 0x7F800000, 0xFF800000, 0x7F7FFFFF, 0xFF7FFFFF, 0x00000001, 0, 0x5F000000)
    for _ in range(rng.choice((1, 3, 20))):
        struct.pack_into("<I", changed, 4 * rng.randrange(len(body) // 4), rng.choice(numbers))
    rows = bytes(changed)
    return header + mark + rng.choice((rows, rows, rows[: rng.randrange(len(rows))], rows * 2, b""))


def _with_another_line_end(data: bytes, rng: random.Random) -> bytes:
    header, mark, body = data.partition(b"end_header\n")
    return (header + mark).replace(b"\n", rng.choice((b"\r\n", b"\r", b"", b" \n", b"\n\n"))) + body


PLY = (_with_another_header_line, _with_another_header_line, _with_another_header_line, _with_other_rows,
       _with_another_line_end)  # fmt: skip
"""Each takes the bytes of a PLY file and a `Random`."""


def large_ply(data: bytes, rng: random.Random, size: int) -> bytes:
    """Return a PLY file with many rows, as its header states them, or with a long header."""
    header, mark, body = data.partition(b"end_header\n")
    count = int(re.findall(rb"element vertex (\d+)", header)[0])
    if rng.random() < 0.3:
        return header + b"comment x\n" * (size // 10) + mark + body
    times = max(1, size // len(body))
    return header.replace(b"element vertex %d" % count, b"element vertex %d" % (count * times)) + mark + body * times


def document_of(data: bytes) -> bytes:
    """Return the JSON part of a GLB."""
    return _chunks(data)[0]


def with_document(data: bytes, text: bytes) -> bytes:
    """Return a GLB with another JSON part, and the sizes of parts that belong to it."""
    rest = _chunks(data)[1]
    text += b" " * (-len(text) % 4)
    return struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON part and the rest of a GLB, whose first part must be JSON."""
    length = struct.unpack_from("<I", data, 12)[0]
    return data[20 : 20 + length], data[20 + length :]


def _with_another_document(data: bytes, rng: random.Random) -> bytes:
    return with_document(data, rng.choice(JSON)(document_of(data), rng))


def _with_another_chunk_head(data: bytes, rng: random.Random) -> bytes:
    text, _ = _chunks(data)
    changed = bytearray(data)
    offset = rng.choice((0, 4, 8, 12, 16, 20 + len(text), 24 + len(text)))
    old = struct.unpack_from("<I", data, offset)[0]
    number = rng.choice((0, 1, old + 1, old - 1, old + 4, 1 << 31, (1 << 32) - 1, old * 2, 0x4E4F534A, 0x004E4942))
    struct.pack_into("<I", changed, offset, number % (1 << 32))
    return bytes(changed)


def _with_other_floats(data: bytes, rng: random.Random) -> bytes:
    text, rest = _chunks(data)
    changed = bytearray(data)
    for _ in range(rng.choice((1, 4))):
        at = 28 + len(text) + 4 * rng.randrange((len(rest) - 8) // 4)
        struct.pack_into("<f", changed, at, rng.choice((float("nan"), float("inf"), 3e38, -1.0, 0.0, 2.0, 1e-44)))
    return bytes(changed)


GLB = (
    _with_another_document,
    _with_another_document,
    _with_another_document,
    _with_another_chunk_head,
    _with_other_floats,
)
"""Each takes the bytes of a GLB and a `Random`."""


def _with_another_tar_header(data: bytes, rng: random.Random) -> bytes:
    """Change a field of the first header of the archive: name, mode, size, checksum, type, link."""
    changed = bytearray(gzip.decompress(data))
    start, length = rng.choice(
        ((0, 100), (100, 8), (124, 12), (124, 12), (148, 8), (156, 1), (156, 1), (157, 100), (257, 8))
    )
    values = (
        b"\0",
        b"\xff",
        b"7",
        b"../x\0",
        b"77777777777\0",
        b"\x80" + b"\0" * 6 + b"\x7f",
        b"-1\0",
        b"L",
        b"S",
        b"x",
        b"g",
    )
    value = (rng.choice(values) * length)[:length]
    changed[start : start + length] = value
    if rng.random() < 0.7:
        changed[148:156] = b" " * 8
        changed[148:156] = b"%06o\0 " % sum(changed[:512])
    return gzip.compress(bytes(changed), 1)


def _with_another_tar(data: bytes, rng: random.Random) -> bytes:
    plain = gzip.decompress(data)
    at = rng.randrange(len(plain))
    return gzip.compress(
        rng.choice((plain[:at], plain[at:], plain + plain, plain[:at] + rng.randbytes(20) + plain[at:])), 1
    )


TAR = (_with_another_tar_header, _with_another_tar_header, _with_another_tar)
"""Each takes the bytes of a gzipped tar and a `Random`."""


def _with_another_length(data: bytes, rng: random.Random) -> bytes:
    """Insert or replace a number of Protocol Buffers: seven bits per byte."""
    at = rng.randrange(min(len(data), 60))
    numbers = (b"\0", b"\x7f", b"\xff\x7f", b"\xff" * 9 + b"\x01", b"\xff" * 20, b"\x80" * 10, b"\xff\xff\xff\xff\x0f")
    return data[:at] + rng.choice(numbers) + data[at + rng.choice((0, 1)) :]


ONNX = (_with_another_length,)
"""Each takes the bytes of an ONNX file and a `Random`."""
