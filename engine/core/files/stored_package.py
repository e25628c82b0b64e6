"""Reading a folder or a zip file whose content nobody vouches for: names, sizes and streams, within bounds.

Nothing is unpacked to the disk. No name leads out of the package, no link is followed, and a zip file that would unpack
to far more than its own size is refused before anything is read from it.
"""

from __future__ import annotations

import contextlib
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from ..errors import FormatError
from .paths import is_inner_name
from .reading import opened

_MAX_FILES = 200_000
_MAX_GROWTH = 100
_FREE_GROWTH = 64 << 20
"""A zip file may unpack to 64 MB and a hundred times its own size. Splats shrink to a tenth at most."""
_MAX_DIRECTORY = 64 << 20
"""Bytes of the list of files at the end of a zip file."""
_ENCRYPTED = 0x1
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_PACKED = (".jpg", ".png", ".webm", ".mp4", ".gz", ".zip")
"""Files that are stored in a zip file as they are: they are compressed already."""
_DAMAGED = (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError, ValueError, OverflowError)
"""Errors that Python's zipfile raises for damaged files."""


class StoredPackage:
    """The files of a package.

    Attributes
    ----------
    path : Path
        The folder or zip file.
    sizes : dict of str to int
        Size in bytes of each file, by its path in the package with forward slashes.
    """

    def __init__(self, path: Path, sizes: dict[str, int], archive: zipfile.ZipFile | None, prefix: str) -> None:
        self.path = path
        self.sizes = sizes
        self._archive = archive
        self._prefix = prefix

    @contextlib.contextmanager
    def reading(self, name: str) -> Iterator[IO[bytes]]:
        """Open one of the files in `sizes`.

        Raises
        ------
        FormatError
            When it cannot be read.
        """
        if self._archive is None:
            with opened(self.path / name, advice=_ADVICE) as stream:
                yield stream
            return
        try:
            with self._archive.open(self._prefix + name) as stream:
                yield stream
        except (*_DAMAGED, KeyError, OSError) as error:
            raise FormatError(f"{name} in {self.path} cannot be read: {error}. {_ADVICE}") from error


_ADVICE = "Copy the package again from where it came from."


@contextlib.contextmanager
def opened_package(path: Path, *, root: str | None = None) -> Iterator[StoredPackage]:
    """Open a folder, or a zip file that holds one folder with everything in it.

    Parameters
    ----------
    root : str, optional
        The name of a file. A zip file then need not hold one folder: names are those beside this file, wherever it is.

    Raises
    ------
    FormatError
        When it cannot be read; has a link, a device, an encrypted file or a name that leads out of it; has the same
        file twice; or would unpack to far more than its size.
    """
    if path.is_dir():
        yield StoredPackage(path, _files_of(path), None, "")
        return
    with opened(path, advice="Choose a package: a folder or a zip file.") as stream:
        try:
            _require_small_directory(path, stream)
            archive = zipfile.ZipFile(stream)
        except (*_DAMAGED, OSError) as error:
            raise FormatError(f"{path} is no zip file that can be read: {error}. {_ADVICE}") from error
        with archive:
            prefix, sizes = _checked_entries(path, archive, root)
            yield StoredPackage(path, sizes, archive, prefix)


def _files_of(folder: Path) -> dict[str, int]:
    sizes: dict[str, int] = {}
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted((*folders, *names)):
            path = Path(parent, name)
            kind = path.lstat().st_mode
            if stat.S_ISDIR(kind):
                continue
            if not stat.S_ISREG(kind):
                raise FormatError(f"{path} is a link or a device, which no package holds. {_ADVICE}")
            sizes[path.relative_to(folder).as_posix()] = path.lstat().st_size
            if len(sizes) > _MAX_FILES:
                raise FormatError(f"{folder} has more than {_MAX_FILES} files. Choose the folder of one package.")
    return sizes


def _require_small_directory(path: Path, stream: IO[bytes]) -> None:
    """Refuse a zip file whose list of files is too large to be held in memory; its size is said at the very end."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - (1 << 16) - 22))
    tail = stream.read()
    place = tail.rfind(b"PK\x05\x06")
    stated = int.from_bytes(tail[place + 12 : place + 16], "little") if place >= 0 else 0
    # 2^32 - 1 refers to the record of zip64, which is as long as it says and lies within the file.
    if min(stated, size) > _MAX_DIRECTORY:
        raise FormatError(f"{path} states a list of files of {stated / 1e6:.0f} MB, which is too large. {_ADVICE}")
    stream.seek(0)


def _checked_entries(path: Path, archive: zipfile.ZipFile, root: str | None) -> tuple[str, dict[str, int]]:
    """Return the folder of the archive, with a slash, and the sizes of its files by the rest of their names."""
    entries = [entry for entry in archive.infolist() if not entry.filename.endswith("/")]
    if len(entries) > _MAX_FILES:
        raise FormatError(f"{path} has more than {_MAX_FILES} files. Choose the file of one package.")
    names = set()
    for entry in entries:
        name = entry.filename
        if not is_inner_name(name) or "\\" in name or ":" in name or name in names:
            raise FormatError(f"{path} has a file with a name that is not allowed: {name!r}. Do not use this package.")
        names.add(name)
        link = stat.S_ISLNK(entry.external_attr >> 16)
        if link or entry.flag_bits & _ENCRYPTED or entry.compress_type not in _METHODS:
            why = "a link" if link else "encrypted" if entry.flag_bits & _ENCRYPTED else "compressed in another way"
            raise FormatError(f"{name} in {path} is {why}, so it is not read. {_ADVICE}")
    size, total = path.stat().st_size, sum(entry.file_size for entry in entries)
    # Entries may overlap, so that the archive is read many times.
    if total > _FREE_GROWTH + _MAX_GROWTH * size or sum(entry.compress_size for entry in entries) > size:
        raise FormatError(
            f"{path} has {size} bytes and would unpack to {total}, far more than a package does. Do not use it."
        )
    if root is not None:
        places = sorted((name.removesuffix(root) for name in names if name.rpartition("/")[2] == root), key=len)
        if not places:
            raise FormatError(f"{path} has no file {root}. Choose another file.")
        prefix = places[0]
        inside = (entry for entry in entries if entry.filename.startswith(prefix))
        return prefix, {entry.filename.removeprefix(prefix): entry.file_size for entry in inside}
    roots = {name.partition("/")[0] for name in names if "/" in name}
    if len(roots) != 1 or any("/" not in name for name in names):
        raise FormatError(f"{path} does not hold exactly one folder, as a package does. Choose another file.")
    prefix = f"{roots.pop()}/"
    return prefix, {entry.filename.removeprefix(prefix): entry.file_size for entry in entries}


def write_zip(stream: IO[bytes], folder: Path, *, name: str, packed: Sequence[str] = ()) -> None:
    """Write all files of `folder` to a zip file, below a folder called `name`.

    Parameters
    ----------
    stream : binary stream
    folder : Path
        Without links.
    packed : sequence of str
        Further suffixes of files that are stored as they are.
    """
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for relative in _files_of(folder):
            is_packed = relative.lower().endswith((*_PACKED, *packed))
            method = zipfile.ZIP_STORED if is_packed else zipfile.ZIP_DEFLATED
            archive.write(folder / relative, f"{name}/{relative}", compress_type=method)
