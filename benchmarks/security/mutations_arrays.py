"""Mutations of NPY, of NPZ and of other zip files: headers, types, shapes, sizes, methods, flags, names and bombs."""

from __future__ import annotations

import io
import random
import re
import struct
import zipfile
from collections.abc import Sequence
from typing import Any

import numpy as np

from .mutations_json import JSON

_TYPES = ("<f4", ">f4", "<f8", "<f2", "|b1", "|u1", "<i4", "<i8", "<u8", "<U3", "|S4", "<c8", "<M8[s]", "<i2", "|V4")
_DESCRIPTIONS = (
    *(f"'{name}'" for name in _TYPES), "'|O'", "'<U1000000000'", "'|V99999999999'", "'<f16'", "'x'", "''", "'f4, f4'",
    "[('a', '<f4'), ('b', '|O')]", "[('a', '<f4', (1000000, 1000000))]", "None", "5", "('<f4', (2,))", "'|V0'", "'<U0'",
    "'(1000000,1000000)f4'", "[]", "'m8[x]'",
)  # fmt: skip
_SHAPES = (
    "()", "(0,)", "(1,)", "(-1,)", "(3,)", "(1000000000000,)", "(4611686018427387904, 4)", "(0, 4611686018427387904)",
    "(0, 99999999999999999999999)", "(2, 3)", "(3, 3)", "(1.0,)", "(True,)", "('3',)", "3", "None", "[3]", "(1,) * 3",
    "(1,) " + "* 99", "(" * 200 + ")" * 200, "(" + "1," * 70 + ")", "(" + "1," * 4000 + ")", "(3, -1)", "(1 << 40,)",
)  # fmt: skip
_HEADERS = (
    b"", b"{", b"}", b"{'descr': '<f4'}", b"[]", b"(" * 9000, b"{'descr': '<f4', 'fortran_order': False, 'shape': (1,)",
    b"\xff" * 60, b"\0" * 60, b"'" * 61, b'"""', b"{'descr': '<f4', 'fortran_order': 5, 'shape': (1,), }\n", b"\\",
    b"-" * 5000,
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (1L,), }", b"1" * 9000, b"__import__('os')", b"lambda: 0",
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'shape': (2,), 'x': 0}",
)  # fmt: skip


def _parts(data: bytes) -> tuple[str, bytes]:
    """Return the header of an NPY file as text, and its values."""
    if not data.startswith(b"\x93NUMPY\x01"):
        raise ValueError("no NPY file of version 1")
    end = 10 + struct.unpack_from("<H", data, 8)[0]
    return data[10:end].decode("latin-1"), data[end:]


def _joined(header: str | bytes, values: bytes, rng: random.Random) -> bytes:
    raw = header.encode("latin-1") if isinstance(header, str) else header
    version = rng.choice((1, 1, 1, 1, 2, 3))
    length = struct.pack("<H", len(raw) & 0xFFFF) if version == 1 else struct.pack("<I", len(raw))
    return b"\x93NUMPY" + bytes([version, 0]) + length + raw + values


def _with_another_type(data: bytes, rng: random.Random) -> bytes:
    header, values = _parts(data)
    description = rng.choice(_DESCRIPTIONS)
    return _joined(re.sub(r"'descr': [^,]+", lambda found: f"'descr': {description}", header), values, rng)


def _with_another_shape(data: bytes, rng: random.Random) -> bytes:
    header, values = _parts(data)
    shape = rng.choice(_SHAPES)
    return _joined(re.sub(r"'shape': \([^)]*\)", lambda found: f"'shape': {shape}", header), values, rng)


def _with_another_header(data: bytes, rng: random.Random) -> bytes:
    header, values = _parts(data)
    return _joined(rng.choice((*_HEADERS, header.replace("False", "True").encode())), values, rng)


def _with_another_array(data: bytes, rng: random.Random) -> bytes:
    """Write a valid array of another type or shape."""
    old = np.load(io.BytesIO(data), allow_pickle=False)
    shape = rng.choice(
        (old.shape, old.shape[::-1], old.shape[1:], (1, *old.shape), (0,) * old.ndim, (2,), (), (7, 5), (0, 3))
    )
    kind = rng.choice((str(old.dtype), str(old.dtype), *_TYPES))
    count = int(np.prod(shape, dtype=np.int64))
    raw = (
        rng.randbytes(count * np.dtype(kind).itemsize) if rng.random() < 0.5 else bytes(count * np.dtype(kind).itemsize)
    )
    new = np.frombuffer(raw, kind).reshape(shape) if np.dtype(kind).itemsize else np.zeros(shape, kind)
    stream = io.BytesIO()
    np.save(stream, np.asfortranarray(new) if rng.random() < 0.3 else new)
    return stream.getvalue()


def _with_other_values(data: bytes, rng: random.Random) -> bytes:
    """Write extreme values into an array, without changing its type and shape."""
    values = np.load(io.BytesIO(data), allow_pickle=False).copy()
    flat = values.reshape(-1)
    chosen = slice(None) if rng.random() < 0.2 else [rng.randrange(flat.size) for _ in range(rng.choice((1, 2, 5)))]
    if values.dtype.kind == "f":
        limits = np.finfo(values.dtype)
        flat[chosen] = rng.choice((np.nan, np.inf, -np.inf, limits.max, limits.min, limits.tiny, 0.0, -1.0, 1e4))
    elif values.dtype.kind in "iu":
        integers = np.iinfo(values.dtype)
        flat[chosen] = rng.choice((integers.max, integers.min, 0, 1, integers.max // 2))
    elif values.dtype.kind == "U":
        text = str(flat[0]).encode()
        flat = np.array([rng.choice(JSON)(text, rng).decode("utf-8", "surrogatepass")])
        values = flat.reshape(values.shape)
    stream = io.BytesIO()
    np.save(stream, flat.reshape(values.shape))
    return stream.getvalue()


ARRAYS = (_with_another_type, _with_another_shape, _with_another_header, _with_another_array, _with_other_values,
          _with_other_values)  # fmt: skip
"""Each takes the bytes of an NPY file and a `Random`."""


# ---- zip


def members_of(data: bytes) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(info.filename, archive.read(info)) for info in archive.infolist()]


def zipped(members: Sequence[tuple[str, bytes]], method: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in members:
            # Not `writestr(name)`: that warns about a name that occurs twice.
            with archive.open(zipfile.ZipInfo(name), "w") as target:
                target.write(content)
    return stream.getvalue()


def _with_another_member(data: bytes, rng: random.Random) -> bytes:
    """Change the content of one file in the archive."""
    members = members_of(data)
    at = rng.randrange(len(members))
    name, content = members[at]
    if name.endswith(".npy"):
        members[at] = name, rng.choice(ARRAYS)(content, rng)
    else:
        members[at] = name, content[: rng.randrange(len(content) + 1)]
    return zipped(members, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))


def _with_other_names(data: bytes, rng: random.Random) -> bytes:
    members = members_of(data)
    at = rng.randrange(len(members))
    name, content = members[at]
    match rng.randrange(5):
        case 0:
            del members[at]
        case 1:
            members.append((name, content[::-1]))
            return _with_repeated_member(members)
        case 2:
            names = (
                "../../x.npy",
                "/x.npy",
                "x",
                ".npy",
                "a/b.npy",
                "\u00fc.npy",
                "x" * 60_000,
                name.upper(),
                "header.npy",
            )
            members[at] = rng.choice(names), content
        case 3:
            members = [(name, content)]
        case _:
            other = rng.randrange(len(members))
            members[at], members[other] = (name, members[other][1]), (members[other][0], content)
    return zipped(members, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))


def _with_repeated_member(members: list[tuple[str, bytes]]) -> bytes:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return zipped(members)


def _compressed_otherwise(data: bytes, rng: random.Random) -> bytes:
    return zipped(members_of(data), rng.choice((zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED)))


_LOCAL, _CENTRAL, _END = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
# Offset and width of each field behind the signature.
_FIELDS: dict[bytes, tuple[tuple[int, int], ...]] = {
    _LOCAL: ((4, 2), (6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2)),
    _CENTRAL: ((4, 2), (6, 2), (8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (30, 2), (32, 2), (38, 4), (42, 4)),
    _END: ((4, 2), (6, 2), (8, 2), (10, 2), (12, 4), (16, 4), (20, 2)),
}


def _with_another_field(data: bytes, rng: random.Random) -> bytes:
    """Change a field of a header: version, flags (encrypted), method, checksum, sizes, lengths, offsets, counts."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2))):
        signature = rng.choice((_LOCAL, _CENTRAL, _CENTRAL, _END))
        start = rng.choice([found.start() for found in re.finditer(re.escape(signature), data)])
        offset, width = rng.choice(_FIELDS[signature])
        old = int.from_bytes(changed[start + offset : start + offset + width], "little")
        numbers = (
            0,
            1,
            8,
            9,
            12,
            14,
            93,
            0x40,
            0x800,
            old + 1,
            old - 1,
            old * 2,
            old ^ 1,
            1 << 20,
            0x7FFFFFFF,
            0xFFFFFFFF,
        )
        number = rng.choice(numbers) % (1 << 8 * width)
        changed[start + offset : start + offset + width] = number.to_bytes(width, "little")
    return bytes(changed)


ZIP = (_with_another_member, _with_another_member, _with_another_member, _with_other_names, _with_another_field,
       _with_another_field, _compressed_otherwise)  # fmt: skip
"""Each takes the bytes of a zip file and a `Random`."""


def bomb(data: bytes, rng: random.Random, size: int) -> bytes:
    """Return an archive of up to `size` bytes: many members, one that decodes to 20 times as much, or a long one."""
    members = members_of(data)
    choice = rng.randrange(3)
    if choice == 0:
        # An entry takes about 120 bytes beside its name.
        return zipped([*members, *((f"{number}.npy", b"") for number in range(min(size, 4_000_000) // 130))])
    at = rng.randrange(len(members))
    name, content = members[at]
    if not name.endswith(".npy"):
        members[at] = name, content + bytes(size * (20 if choice == 1 else 1))
    else:
        members[at] = name, long_array(content, size * (20 if choice == 1 else 1))
    return zipped(members, zipfile.ZIP_DEFLATED if choice == 1 else zipfile.ZIP_STORED)


def long_array(content: bytes, n_bytes: int) -> bytes:
    """Return the bytes of an NPY file with an array whose first axis is longer."""
    old: Any = np.load(io.BytesIO(content), allow_pickle=False)
    if old.ndim == 0:
        text = str(old) if old.dtype.kind == "U" else "0"
        new = np.array(text + " " * (min(n_bytes, 8_000_000) // 4))
    else:
        row = old.dtype.itemsize * max(1, int(np.prod(old.shape[1:])))
        new = np.zeros((n_bytes // row, *old.shape[1:]), old.dtype)
    stream = io.BytesIO()
    np.save(stream, new)
    return stream.getvalue()
