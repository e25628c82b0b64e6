"""Mutations of small valid files, for `fuzz`: some know the format, others change single bytes.

Our own: Hypothesis makes values from a grammar and not damaged files, and Atheris exists for Linux only, instruments
the code and stops at the first error. These mutations depend on the seed alone, so every input can be made again.
"""

from __future__ import annotations

import gzip
import math
import random
import re
import struct
from collections.abc import Callable, Mapping
from functools import partial

from .mutations_arrays import ARRAYS, ZIP, bomb, long_array, members_of, zipped
from .mutations_binary import GLB, ONNX, PLY, TAR, document_of, large_ply, with_document
from .mutations_json import JSON
from .mutations_pictures import HEIC, JPEG, PNG, TIFF, WEBP, large_picture, png_bomb

Mutator = Callable[[bytes, random.Random], bytes]

_MAX_BYTES = 10_000_000


def mutated(data: bytes, kind: str, rng: random.Random) -> bytes:
    """Return a damaged copy of a file.

    Parameters
    ----------
    data : bytes
        A valid file.
    kind : str
        One of `KINDS`.
    rng : Random
        Decides everything.

    Returns
    -------
    bytes
        At most 10 MB, unless `data` is larger.
    """
    of_format = KINDS[kind]
    n_of_format, n_of_bytes = rng.choice(((1, 0), (1, 0), (1, 0), (2, 0), (3, 0), (1, 1), (0, 1), (0, 2), (0, 4)))
    result = data
    for mutators in (*(of_format,) * (n_of_format if of_format else 0), *(_OF_BYTES,) * n_of_bytes):
        try:
            result = rng.choice(mutators)(result, rng)
        # A file that another mutation damaged before may not be readable any more.
        except Exception:
            result = rng.choice(_OF_BYTES)(result or b"\0", rng)
    # Small files stay small here: `enlarged` makes the large ones.
    return result[: max(_MAX_BYTES, len(data))] if result != data else _cut(data, rng)


def enlarged(data: bytes, kind: str, rng: random.Random) -> bytes:
    """Return a file of 10 MB, or of a size between 300 kB and 10 MB; parameters as of `mutated`."""
    size = _MAX_BYTES if rng.random() < 0.3 else int(math.exp(rng.uniform(math.log(3e5), math.log(_MAX_BYTES))))
    make = _LARGE.get(kind, _repeated)
    try:
        return make(data, rng, size)[:_MAX_BYTES]
    except Exception:
        return _repeated(data, rng, size)


def _place(data: bytes | bytearray, rng: random.Random) -> int:
    """Return a place in `data`: half of the time in its first 200 bytes, where headers are."""
    end = len(data) if rng.random() < 0.5 else min(len(data), 200)
    return rng.randrange(end) if end else 0


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))] if data else b"\0"


def _with_flipped_bits(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 2, 8, 32))):
        changed[_place(changed, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _with_another_byte(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    return data[:at] + bytes([rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0x1B, rng.randrange(256)))]) + data[at + 1 :]


def _with_another_number(data: bytes, rng: random.Random) -> bytes:
    """Write a number of 2, 4 or 8 bytes over any place."""
    at, order, code = _place(data, rng), rng.choice("<>"), rng.choice("HIQfdIQ")
    whole: tuple[int, ...] = (
        0,
        1,
        2,
        3,
        0x7F,
        0x80,
        0xFF,
        0x7FFF,
        0xFFFF,
        1 << 20,
        1 << 31,
        (1 << 31) - 1,
        (1 << 32) - 1,
        1 << 40,
    )
    whole += (1 << 62, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
    if code in "fd":
        number: float = rng.choice((math.nan, math.inf, -math.inf, 1e30, -1e30, 0.0, -1.0, 1e-30))
    else:
        number = rng.choice(whole) % (1 << 8 * struct.calcsize(code))
    packed = struct.pack(order + code, number)
    return data[:at] + packed + data[at + len(packed) :]


def _without_part(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + rng.choice((1, 2, 4, 8, 100, rng.randrange(len(data) + 1))) :]


def _with_repeated_part(data: bytes, rng: random.Random) -> bytes:
    start, at = _place(data, rng), _place(data, rng)
    part = data[start : start + rng.choice((1, 4, 16, 256))]
    return data[:at] + part * rng.choice((1, 2, 50)) + data[at:]


def _with_zeros(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    length = min(rng.choice((4, 16, 512)), len(data) - at)
    return data[:at] + bytes([rng.choice((0, 0xFF))]) * length + data[at + length :]


def _with_more(data: bytes, rng: random.Random) -> bytes:
    return data + rng.choice((b"\0", b"\n", data, rng.randbytes(64), b"\0" * 4096))


def _with_other_digits(data: bytes, rng: random.Random) -> bytes:
    """Replace a number that is written as text."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?", data))
    if not found:
        return _with_flipped_bits(data, rng)
    one = rng.choice(found)
    words = (
        b"0",
        b"-1",
        b"1",
        b"1e999",
        b"nan",
        b"-inf",
        b"1000000000000",
        b"9" * 30,
        b"9" * 5000,
        b"",
        b"x",
        b"1e-400",
    )
    words += (b"2147483648", b"18446744073709551616", b"1.5", b"0x10", b"1_0", b"\xd9\xa1")
    return data[: one.start()] + rng.choice(words) + data[one.end() :]


_OF_BYTES: tuple[Mutator, ...] = (
    _cut, _with_flipped_bits, _with_another_byte, _with_another_number, _without_part, _with_repeated_part, _with_zeros,
    _with_more, _with_other_digits,
)  # fmt: skip


def _with_other_lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, rng.choice(lines))
        case 2:
            lines[at] = lines[at] * 2000
        case 3:
            lines[at] = rng.choice((b"\xff\xfe", b"\xed\xa0\x80", b"\0", b"\x1b[2J", b"#", b'"', "\u202e".encode()))
        case 4:
            lines[at] = b" ".join(lines[at].split()[:-1])
        case _:
            lines = [*lines[at:], *lines[:at]]
    return b"\n".join(lines)


def _with_another_word(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"\S+", data))
    one = rng.choice(found)
    words = (b"../../x", b"/etc/passwd", b"NONSENSE", b"-1", b"nan", b"1e400", b"9" * 25, b"x" * 70_000, b"\xff", b"0")
    return data[: one.start()] + rng.choice(words) + data[one.end() :]


def _with_another_event(data: bytes, rng: random.Random) -> bytes:
    """Change one line of a file of JSON lines."""
    lines = data.split(b"\n")
    at = rng.randrange(len(lines) - 1)
    lines[at] = rng.choice(JSON)(lines[at], rng)
    return b"\n".join(lines)


_TEXT: tuple[Mutator, ...] = (_with_other_lines, _with_another_word, _with_other_digits)


def _with_entities(data: bytes, rng: random.Random) -> bytes:
    """Put a document type with entities that grow, or that name a file, before the first element."""
    start = data.index(b"<", data.find(b"?>") + 1)
    inner = rng.choice(
        (b'<!ENTITY a "xxxxxxxx"><!ENTITY b "&a;&a;&a;&a;">', b'<!ENTITY b SYSTEM "file:///etc/passwd">')
    )
    text = re.sub(rb">([^<>]+)<", rb">&b;<", data[start:], count=rng.randrange(2))
    return data[:start] + b"<!DOCTYPE x [" + inner + b"]>" + text


def _with_another_element(data: bytes, rng: random.Random) -> bytes:
    """Remove, repeat or nest an element or a part of one."""
    tags = list(re.finditer(rb"<[^<>]*>", data))
    one, other = sorted(rng.sample(tags, 2), key=re.Match.start)
    inner = data[one.start() : other.end()]
    return data[: one.start()] + rng.choice((b"", inner * 2, b"<a>" * 200 + inner)) + data[other.end() :]


_XML: tuple[Mutator, ...] = (_with_entities, _with_another_element, _with_another_element, *_TEXT)


def _with_other_content(data: bytes, rng: random.Random) -> bytes:
    """Damage what a gzip stream holds: mostly the 16 bytes of the header of SPZ, or its length."""
    content = bytearray(gzip.decompress(data))
    what = rng.random()
    if what < 0.5:
        content[rng.randrange(4, 15)] = rng.choice((0, 1, 2, 3, 4, 24, 127, 128, 255))
    elif what < 0.75:
        content = bytearray(_cut(bytes(content), rng) if rng.random() < 0.5 else _with_more(bytes(content), rng))
    else:
        content = bytearray(_with_flipped_bits(bytes(content), rng))
    return gzip.compress(bytes(content), 1)


def _with_another_header(data: bytes, rng: random.Random) -> bytes:
    """Write a number over one of those in the headers of KSPLAT, which are mostly empty."""
    content = bytearray(data)
    at = rng.choice((0, *range(4, 44, 4), *range(4096, 4138, 2)))
    struct.pack_into("<I", content, at, rng.choice((0, 1, 2, 7, 255, 256, 65535, 1 << 20, 1 << 31, (1 << 32) - 1)))
    return bytes(content)


def _with_another_part(data: bytes, rng: random.Random) -> bytes:
    """Damage a part of a SOG: mostly its description, otherwise one of its pictures."""
    members = members_of(data)
    wanted = ".json" if rng.random() < 0.7 else ".webp"
    at = rng.choice([number for number, (name, _) in enumerate(members) if name.endswith(wanted)])
    name, content = members[at]
    members[at] = name, rng.choice(JSON if wanted == ".json" else WEBP)(content, rng)
    return zipped(members)


KINDS: Mapping[str, tuple[Mutator, ...]] = {
    "json": JSON,
    "jsonl": (_with_another_event, _with_another_event, _with_another_event, *_TEXT),
    "txt": _TEXT,
    "out": _TEXT,
    "md": _TEXT,
    "pem": _TEXT,
    "csv": _TEXT,
    "xml": _XML,
    "xmp": _XML,
    "npy": ARRAYS,
    "npz": ZIP,
    "zip": ZIP,
    "tgz": TAR,
    "ply": PLY,
    "glb": GLB,
    "onnx": ONNX,
    "jpg": JPEG,
    "png": PNG,
    "tif": TIFF,
    "webp": WEBP,
    "heic": HEIC,
    # Counts and sizes of 8 bytes between numbers: changing bytes finds them.
    "bin": (_with_another_number,),
    "spz": (_with_other_content,),
    "spz4": (_with_another_number, _with_zeros),
    "sog": (_with_another_part, _with_another_part, *ZIP),
    "splat": (_with_another_number, _with_zeros),
    "ksplat": (_with_another_number, _with_another_header),
    "usda": _TEXT,
    "usdc": (_with_another_number, _with_zeros),
    "mp4": (_with_another_number, _with_zeros),
    "db": (_with_another_number, _with_zeros),
}
"""Mutations by suffix of the file."""


# ---- large files


def _repeated(data: bytes, rng: random.Random, size: int) -> bytes:
    start = _place(data, rng)
    part = data[start : start + rng.choice((1, 64, 4096))] or b"\0"
    return data[:start] + part * (size // len(part)) + data[start:]


def _large_json(data: bytes, rng: random.Random, size: int) -> bytes:
    """Put a long list, text, number or a deep nest at the place of a value."""
    values = list(re.finditer(rb'"(?:[^"\\]|\\.)*"|-?\d[\d.eE+-]*|true|false|null|\{\}|\[\]', data))
    one = rng.choice(values)
    item = rng.choice((b"0,", b"{},", b"[],", b'"",', b"[[0]],", b"1.5,", b'{"a":{}},', data.strip() + b","))
    large = (
        b"[" + (item * (size // len(item) + 1)).rstrip(b",") + b"]",
        b'"' + b"x" * size + b'"',
        b'"' + b"\\u0041" * (size // 6) + b'"',
        b"9" * size,
        b"[" * (size // 2) + b"]" * (size // 2),
        b"{" + b",".join(b'"k%d":0' % number for number in range(size // 12)) + b"}",
    )
    return data[: one.start()] + rng.choice(large) + data[one.end() :]


def _large_lines(data: bytes, rng: random.Random, size: int) -> bytes:
    if rng.random() < 0.5:
        return data * (size // len(data) + 1)
    lines = data.split(b"\n")
    lines[0] = _large_json(lines[0], rng, size)
    return b"\n".join(lines)


def _large_tar(data: bytes, rng: random.Random, size: int) -> bytes:
    return gzip.compress(gzip.decompress(data) + bytes(size * 20), 1)


_LARGE: Mapping[str, Callable[[bytes, random.Random, int], bytes]] = {
    "json": _large_json,
    "jsonl": _large_lines,
    "npy": lambda data, rng, size: long_array(data, size - 200),
    "npz": bomb,
    "zip": bomb,
    "tgz": _large_tar,
    "spz": _large_tar,
    "sog": bomb,
    "ply": large_ply,
    "glb": lambda data, rng, size: with_document(data, _large_json(document_of(data), rng, size)),
    "png": png_bomb,
    "jpg": partial(large_picture, "JPEG"),
    "tif": partial(large_picture, "TIFF"),
    "webp": partial(large_picture, "WEBP"),
    "heic": partial(large_picture, "HEIF"),
}
