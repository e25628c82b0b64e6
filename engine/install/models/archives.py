"""Read one file from a wheel, a zip or a gzipped tar, without trusting what the archive says about itself."""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, cast

from ...core.errors import HeritageError, ModelFileError
from ...core.files import opened

_MAX_DIRECTORY_BYTES = 4 << 20
"""Of an archive's list of files: some 80,000 names. Python's objects take 20 times more."""


@contextlib.contextmanager
def open_member(package: Path, member: str, size: int, *, max_bytes: int) -> Iterator[IO[bytes] | None]:
    """Open a file inside of an archive; give None when the archive has no such file.

    Parameters
    ----------
    package : Path
        A zip file (wheel) or a gzipped tar.
    member : str
        Name of the file in the archive.
    size : int
        Its size in bytes, unpacked.
    max_bytes : int
        How large the archive may be, packed, and how much of it may be unpacked to get at the file.

    Raises
    ------
    ModelFileError
        When the archive is damaged or larger, or the file in it has another size; also while the stream is read.
    FormatError
        When the archive cannot be opened.
    """
    with opened(package, advice="Fetch the package again.") as stream, contextlib.ExitStack() as stack:
        try:
            if package.stat().st_size > max_bytes:
                raise ValueError(f"it is larger than {max_bytes / 1e6:.0f} MB")
            if zipfile.is_zipfile(stream):
                found = _open_in_zip(stack, stream, member, size)
            else:
                stream.seek(0)
                found = _open_in_tar(stack, _Unpacked(stream, max_bytes), member, size)
        except Exception as error:
            raise _damaged(package, error) from error
        yield None if found is None else cast(IO[bytes], _Member(found, package))


class _Member(io.RawIOBase):
    """A file in an archive whose read errors are ours."""

    def __init__(self, stream: IO[bytes], package: Path) -> None:
        self._stream, self._package = stream, package

    def read(self, size: int = -1) -> bytes:
        try:
            return self._stream.read(size)
        except Exception as error:
            raise _damaged(self._package, error) from error


def _open_in_zip(stack: contextlib.ExitStack, stream: IO[bytes], member: str, size: int) -> IO[bytes] | None:
    archive = stack.enter_context(zipfile.ZipFile(_SmallReads(stream)))
    try:
        entry = archive.getinfo(member)
    except KeyError:
        return None
    # The other methods unpack without a limit for each piece.
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member} is packed in a way that wheels do not use")
    _require_size(member, entry.file_size, size)
    return stack.enter_context(archive.open(entry))


def _open_in_tar(stack: contextlib.ExitStack, unpacked: _Unpacked, member: str, size: int) -> IO[bytes] | None:
    archive = stack.enter_context(tarfile.TarFile(fileobj=unpacked))
    while (entry := archive.next()) is not None:
        if entry.name == member and entry.isreg():
            _require_size(member, entry.size, size)
            unpacked.allow(size)
            content = archive.extractfile(entry)
            return None if content is None else stack.enter_context(content)
    return None


class _SmallReads(io.RawIOBase):
    """A file that is never read in large pieces: zipfile reads the whole list of files at once, whatever its size."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def read(self, size: int = -1) -> bytes:
        data = self._stream.read(min(size, _MAX_DIRECTORY_BYTES + 1) if size >= 0 else _MAX_DIRECTORY_BYTES + 1)
        if len(data) > _MAX_DIRECTORY_BYTES:
            raise ValueError("its list of files is too long")
        return data


class _Unpacked(io.RawIOBase):
    """The unpacked bytes of a gzipped tar, up to a limit; only the headers can be read until `allow` is called."""

    def __init__(self, stream: IO[bytes], max_bytes: int) -> None:
        self._stream = gzip.GzipFile(fileobj=stream)
        self._max_bytes = max_bytes
        self._left = _MAX_DIRECTORY_BYTES

    def allow(self, size: int) -> None:
        """Allow to read `size` more bytes."""
        self._left += size

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._stream.tell()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        # Going back would unpack everything again.
        if whence != os.SEEK_SET or not self.tell() <= offset <= self._max_bytes:
            raise ValueError(f"it unpacks to more than {self._max_bytes / 1e6:.0f} MB")
        return self._stream.seek(offset)

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= self._left or self.tell() + size > self._max_bytes:
            raise ValueError("its list of files is too long")
        self._left -= size
        return self._stream.read(size)


def _require_size(member: str, found: int, size: int) -> None:
    if found != size:
        raise ValueError(f"{member} has {found:,} bytes, must be {size:,}")


def _damaged(package: Path, error: Exception) -> HeritageError:
    # zipfile, tarfile, gzip and zlib raise a dozen types for a damaged archive, RuntimeError, struct.error and
    # UnicodeDecodeError among them.
    if isinstance(error, HeritageError):
        return error
    return ModelFileError(f"The package {package.name} is damaged ({error or type(error).__name__}). Fetch it again.")
