"""The readers of NumPy files: type and shape are checked against the size of the file before anything is allocated.

Pickled objects are never loaded.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import FormatError
from ..system import free_memory
from .reading import opened

_MAX_HEADER_BYTES = 10_000
_MAX_ARRAY_BYTES = 16 << 30
_MAX_MEMBERS = 4096
_CHUNK_BYTES = 1 << 20
_CHECKED_AGAINST_FREE_MEMORY = 128 << 20
_MAX_TEXT_BYTES = 64 << 20
_MAX_DEFLATED_BYTES = 512 << 20
"""Decoded size of all deflated arrays of a file, so that a small file is not read for minutes."""
_DEFLATE_RATIO = 1032
"""No deflated stream decodes to more than this many times its size."""


class _Unreadable(ValueError):
    """A sentence about a damaged array file, without the file's name."""


@dataclass(frozen=True)
class ArraySpec:
    """The dtype and shape that a stored array must have.

    Attributes
    ----------
    dtype : str
        NumPy types that are allowed, separated by ``|``, e.g. ``"float32"`` or ``"float16|float32"``; ``"str"`` allows
        text.
    shape : tuple of int or str, or None
        Length of each axis: -1 stands for any, a name for any that is the same in all arrays of the file. None allows
        every shape.
    finite : bool
        Whether NaN and infinite values are errors.
    """

    dtype: str
    shape: tuple[int | str, ...] | None = None
    finite: bool = False


def read_array(path: Path, spec: ArraySpec, *, advice: str, mapped: bool = False) -> NDArray[Any]:
    """Return the array of a ``.npy`` file.

    Parameters
    ----------
    advice : str
        One or more sentences: what the user should do about a damaged file.
    mapped : bool
        Return a read-only memory map, so that only the pages that are used are read.

    Raises
    ------
    FormatError
        When the file cannot be read, or is not what `spec` says.
    """
    with opened(path, advice=advice) as stream:
        size = path.stat().st_size
        try:
            shape, fortran_order, dtype = _header(stream)
            _require(shape, dtype, spec, {})
            if stream.tell() + _n_bytes(shape, dtype) != size:
                raise _Unreadable(f"its header states {_n_bytes(shape, dtype):,} bytes of values, it has another size")
            if mapped and _n_bytes(shape, dtype):
                order: Literal["F", "C"] = "F" if fortran_order else "C"
                values: NDArray[Any] = np.memmap(path, dtype, "r", stream.tell(), shape, order)
            else:
                values = _values(stream, shape, fortran_order, dtype)
            _require_finite(values, spec)
        # OverflowError: a length beside 0 that NumPy cannot hold.
        except (_Unreadable, OSError, ValueError, OverflowError) as error:
            raise FormatError(f"{path} cannot be read: {_clause(error)}. {advice}") from error
    return values


def read_arrays(
    path: Path,
    specs: Mapping[str, ArraySpec],
    *,
    advice: str,
    optional: Mapping[str, ArraySpec] | None = None,
    only: frozenset[str] | None = None,
) -> dict[str, NDArray[Any]]:
    """Return the arrays of an ``.npz`` file, each checked before it is decoded.

    Parameters
    ----------
    specs : mapping of str to ArraySpec
        Arrays that the file must have.
    optional : mapping of str to ArraySpec
        Arrays that it may have. A key ending in ``*`` stands for every name that begins like it.
    only : frozenset of str, optional
        Names to return; by default all of `specs` and `optional`. Other arrays are not decoded.

    Raises
    ------
    FormatError
        When the file cannot be read, lacks an array, or an array is not what its spec says.
    """
    lengths: dict[str, int] = {}
    values: dict[str, NDArray[Any]] = {}
    with opened(path, advice=advice) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
                if len(members) > _MAX_MEMBERS:
                    raise _Unreadable(f"it has {len(members):,} arrays")
                missing = sorted(set(specs) - set(members))
                if missing:
                    raise _Unreadable(f"`{missing[0]}` is missing")
                wanted = {
                    name: spec
                    for name in members
                    if (only is None or name in only)
                    and (spec := specs.get(name) or _matching(name, optional or {})) is not None
                }
                _require_bounded([members[name] for name in wanted], path.stat().st_size)
                for name, spec in wanted.items():
                    values[name] = _member(archive, members[name], name, spec, lengths)
        # What zipfile and zlib raise on damaged, encrypted or unknown streams.
        except (
            zipfile.BadZipFile,
            zlib.error,
            ValueError,
            OSError,
            EOFError,
            RuntimeError,
            NotImplementedError,
            OverflowError,
            KeyError,
        ) as error:
            raise FormatError(f"{path} cannot be read: {_clause(error)}. {advice}") from error
    return values


def _clause(error: Exception) -> str:
    """Return the text of an error for a message; those of zipfile quote names of the file, of any length."""
    return str(error)[:200].rstrip(".") or type(error).__name__


def _require_bounded(members: list[zipfile.ZipInfo], file_size: int) -> None:
    """Raise `_Unreadable` when a small archive would decode to too much: by overlapping members, or deflated ones."""
    if sum(info.compress_size for info in members) > file_size:
        raise _Unreadable("its arrays overlap")
    deflated = sum(info.file_size for info in members if info.compress_type != zipfile.ZIP_STORED)
    if deflated > _MAX_DEFLATED_BYTES:
        raise _Unreadable(f"its compressed arrays state {deflated / 1e9:.1f} GB")


def _matching(name: str, specs: Mapping[str, ArraySpec]) -> ArraySpec | None:
    if name in specs:
        return specs[name]
    return next((spec for key, spec in specs.items() if key.endswith("*") and name.startswith(key[:-1])), None)


def _member(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, spec: ArraySpec, lengths: dict[str, int]
) -> NDArray[Any]:
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise _Unreadable(f"`{name}` is compressed with an unknown method")
    if info.file_size > (info.compress_size + 64) * _DEFLATE_RATIO:
        raise _Unreadable(f"`{name}` states a size that its data cannot have")
    with archive.open(info) as stream:
        shape, fortran_order, dtype = _header(stream)
        try:
            _require(shape, dtype, spec, lengths)
            n_bytes = _n_bytes(shape, dtype)
            if stream.tell() + n_bytes != info.file_size:
                raise _Unreadable(f"its header states {n_bytes:,} bytes of values, it has another size")
            values = _values(stream, shape, fortran_order, dtype)
            stream.read(1)  # reaches the end, where the checksum is checked
            _require_finite(values, spec)
        except _Unreadable as error:
            raise _Unreadable(f"`{name}`: {error}") from error
    return values


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order and type; the stream then stands at the values."""
    start = stream.read(npy.MAGIC_LEN)
    if len(start) < npy.MAGIC_LEN or not start.startswith(npy.MAGIC_PREFIX):
        raise _Unreadable("it is not a NumPy file")
    width = 2 if start[-2] == 1 else 4
    length_bytes = stream.read(width)
    length = int.from_bytes(length_bytes, "little")
    if length > _MAX_HEADER_BYTES:
        raise _Unreadable("its header is too long")
    header = io.BytesIO(length_bytes + stream.read(length))
    read = npy.read_array_header_1_0 if width == 2 else npy.read_array_header_2_0
    try:
        shape, fortran_order, dtype = read(header)
    # The header is a Python literal; NumPy passes on what the parser raises on a damaged one.
    except Exception as error:
        raise _Unreadable("its header is damaged") from error
    if dtype.hasobject or any(not isinstance(n, int) or isinstance(n, bool) or n < 0 for n in shape):
        raise _Unreadable("its header is damaged")
    return shape, fortran_order, dtype


def _n_bytes(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    return math.prod(shape) * dtype.itemsize


def _require(shape: tuple[int, ...], dtype: np.dtype[Any], spec: ArraySpec, lengths: dict[str, int]) -> None:
    """Raise `_Unreadable` unless type and shape are what `spec` says; named lengths are noted in `lengths`."""
    allowed = spec.dtype.split("|")
    if not any(dtype.kind == "U" if name == "str" else dtype == np.dtype(name) for name in allowed):
        raise _Unreadable(f"it has values of the type {dtype}, not {' or '.join(allowed)}")
    if _n_bytes(shape, dtype) > (_MAX_TEXT_BYTES if dtype.kind == "U" else _MAX_ARRAY_BYTES):
        raise _Unreadable("it is too large")
    if spec.shape is None:
        return
    fits = len(shape) == len(spec.shape) and all(
        wanted == -1 or length == (wanted if isinstance(wanted, int) else lengths.setdefault(wanted, length))
        for length, wanted in zip(shape, spec.shape, strict=True)
    )
    if not fits:
        wanted_shape = " x ".join(str(lengths.get(str(n), n)) for n in spec.shape) or "a single value"
        raise _Unreadable(f"it has the shape {' x '.join(map(str, shape)) or 'of a single value'}, not {wanted_shape}")


def _values(stream: IO[bytes], shape: tuple[int, ...], fortran_order: bool, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Read an array in chunks into memory that is allocated once."""
    n_bytes = _n_bytes(shape, dtype)
    free = free_memory() if n_bytes > _CHECKED_AGAINST_FREE_MEMORY else None
    if free is not None and n_bytes > free:
        raise _Unreadable(f"it takes {n_bytes / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free")
    flat = np.empty(math.prod(shape), dtype)
    data = flat.view(np.uint8) if n_bytes else np.empty(0, np.uint8)
    filled = 0
    while filled < n_bytes:
        chunk = stream.read(min(_CHUNK_BYTES, n_bytes - filled))
        if not chunk:
            raise _Unreadable("it ends too early")
        data[filled : filled + len(chunk)] = np.frombuffer(chunk, np.uint8)
        filled += len(chunk)
    return flat.reshape(shape[::-1]).T if fortran_order else flat.reshape(shape)


def _require_finite(values: NDArray[Any], spec: ArraySpec) -> None:
    if spec.finite and values.dtype.kind == "f" and not np.isfinite(values).all():
        raise _Unreadable("it has values that are not finite")
