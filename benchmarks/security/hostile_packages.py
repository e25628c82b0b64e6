"""Hostile packages for `verify`: lists, links and zip files that lead out of them, bombs, and truncated files."""

from __future__ import annotations

import hashlib
import os
import struct
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

from .hostile_cases import Case, Sandbox

_FILES = {"data/vase.ply": b"ply\n" * 20, "data/records/lido.xml": b"<lido/>\n"}
_BAGIT = b"BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"
_NOTES = "../../precious/notes.txt"
"""A file of the curator, from the package."""
_MANIFEST = "manifest-sha256.txt"


def package_of(sandbox: Sandbox) -> Path:
    """Return the package that was sent: a zip file where there is one, otherwise a folder."""
    archive = sandbox.root / "sent" / "bag.zip"
    return archive if archive.exists() else sandbox.root / "sent" / "bag"


def _write_bag(sandbox: Sandbox) -> Path:
    bag = sandbox.root / "sent" / "bag"
    lines = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in _FILES.items())
    for name, data in {**_FILES, "bagit.txt": _BAGIT, _MANIFEST: lines.encode()}.items():
        (bag / name).parent.mkdir(parents=True, exist_ok=True)
        (bag / name).write_bytes(data)
    return bag


def _write_zip(sandbox: Sandbox, *more: tuple[zipfile.ZipInfo | str, bytes]) -> Path:
    """Write a good package as a zip file, with `more` entries."""
    bag, archive = _write_bag(sandbox), sandbox.root / "sent" / "bag.zip"
    with warnings.catch_warnings(), zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as stream:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for file in sorted(path for path in bag.rglob("*") if path.is_file()):
            stream.write(file, f"bag/{file.relative_to(bag).as_posix()}")
        for entry, data in more:
            stream.writestr(entry, data)
    return archive


def _folder(name: str, change: Callable[[Path, Sandbox], object]) -> Case:
    return Case(f"package: {name}", lambda sandbox: change(_write_bag(sandbox), sandbox), is_package=True)


def _archive(name: str, *more: tuple[zipfile.ZipInfo | str, bytes]) -> Case:
    return Case(f"package: {name}", lambda sandbox: _write_zip(sandbox, *more), is_package=True)


def _changed_zip(name: str, change: Callable[[bytes], bytes]) -> Case:
    def make(sandbox: Sandbox) -> None:
        archive = _write_zip(sandbox)
        archive.write_bytes(change(archive.read_bytes()))

    return Case(f"package: {name}", make, is_package=True)


def _listed(name: str) -> Case:
    def change(bag: Path, sandbox: Sandbox) -> None:
        line = f"{hashlib.sha256((sandbox.precious / 'notes.txt').read_bytes()).hexdigest()}  {name}\n"
        with (bag / _MANIFEST).open("a", encoding="utf-8") as stream:
            stream.write(line)

    return _folder(f"list that names {name!r}", change)


def _linked(name: str, target: str) -> Case:
    """Return a package in which `name` is a link to `target`, from the curator's folder."""

    def change(bag: Path, sandbox: Sandbox) -> None:
        place = bag / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.unlink(missing_ok=True)
        place.symlink_to(target if target.startswith("/") else sandbox.root / target)

    return _folder(f"{name} is a link to {target}", change)


def _link_entry(target: bytes) -> tuple[zipfile.ZipInfo, bytes]:
    entry = zipfile.ZipInfo("bag/data/link")
    entry.external_attr = 0o120777 << 16
    return entry, target


def _entries_that_overlap(data: bytes) -> bytes:
    """Return the zip file whose list names its first file a thousand times."""
    begin, end = data.index(b"PK\x01\x02"), data.index(b"PK\x05\x06")
    entry = data[begin : data.index(b"PK\x01\x02", begin + 4)]
    place = entry.index(b"bagit.txt")
    entries = [entry[:place] + f"{n:05}.txt".encode() + entry[place + 9 :] for n in range(1000)]
    tail = bytearray(data[end:])
    struct.pack_into("<HHI", tail, 8, len(entries), len(entries), sum(map(len, entries)))
    return data[:begin] + b"".join(entries) + bytes(tail)


def _encrypted(data: bytes) -> bytes:
    """Return the zip file whose list says that its first file is encrypted."""
    place = data.index(b"PK\x01\x02") + 8
    return data[:place] + struct.pack("<H", 1) + data[place + 2 :]


def _fetch(bag: Path, sandbox: Sandbox) -> None:
    (bag / "fetch.txt").write_text("https://example.org/vase.ply 80 data/vase.ply\n", encoding="utf-8")


def _weak(bag: Path, sandbox: Sandbox) -> None:
    (bag / _MANIFEST).rename(bag / "manifest-md5.txt")


def _pipe(bag: Path, sandbox: Sandbox) -> None:
    os.mkfifo(bag / "data" / "pipe")


def _truncated(bag: Path, sandbox: Sandbox) -> None:
    for name in ("data/vase.ply", "data/records/lido.xml"):
        (bag / name).write_bytes(_FILES[name][:-1])


def _cut_list(bag: Path, sandbox: Sandbox) -> None:
    text = (bag / _MANIFEST).read_bytes()
    (bag / _MANIFEST).write_bytes(text[: len(text) // 2])


PACKAGES: tuple[Case, ...] = (
    *(_listed(name) for name in (_NOTES, f"data/{_NOTES}", "/etc/hostname", "C:\\x", "\\\\server\\share\\x")),
    *(_listed(name) for name in ("data/a\0b", "data/%2e%2e/%2e%2e/x", "data/..%0A/x", "~/.profile")),
    _linked("data/link", "precious/notes.txt"),
    _linked("data/vase.ply", "precious/notes.txt"),
    _linked("data/folder", "precious/project"),
    _linked("data/loop", "sent/bag/data"),
    _linked("data/itself", "sent/bag/data/itself"),
    _linked("data/zero", "/dev/zero"),
    _linked(_MANIFEST, "precious/notes.txt"),
    _linked("bagit.txt", "precious/notes.txt"),
    _folder("with a pipe", _pipe),
    _folder("whose files are in the web", _fetch),
    _folder("with MD5 alone", _weak),
    _folder("with truncated files", _truncated),
    _folder("with a truncated list", _cut_list),
    *(_archive(f"zip file with {name!r}", (name, b"x")) for name in (_NOTES, "/etc/x", "bag/../../x", "C:/x")),
    *(_archive(f"zip file with {name!r}", (name, b"x")) for name in ("bag/data\\..\\..\\x", "bag/bagit.txt")),
    _archive("zip file with a name of 60,000 letters", ("bag/data/" + "a/" * 29_995 + "a", b"x")),
    _archive("zip file with a link to the curator's notes", _link_entry(b"../../../precious/notes.txt")),
    _archive("zip file with a link to /dev/zero", _link_entry(b"/dev/zero")),
    _archive("zip file that unpacks to 256 MB", ("bag/data/zeros", bytes(256 << 20))),
    _changed_zip("zip file whose files overlap", _entries_that_overlap),
    _changed_zip("zip file that is said to be encrypted", _encrypted),
    *(_changed_zip(f"zip file of which {share:.0%} are there", lambda data, share=share: data[: int(len(data) * share)])
      for share in (0.0, 0.1, 0.5, 0.9, 0.99)),
)  # fmt: skip
