"""Changes of a package since it was made: its files against its lists of hashes (BagIt, RFC 8493).

Our own reader instead of the library ``bagit``, because a package may come from anywhere and may be a zip file: the
lists are read within bounds, no link is followed, and no file outside of the package is opened.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import Cancelled, FormatError
from ...core.events import StopCheck, never_stop
from ...core.files import StoredPackage, is_inner_name, opened_package

_ALGORITHMS = ("sha512", "sha256")
"""Hashes that nobody can forge, the preferred first. Packages with MD5 or SHA-1 alone are refused."""
_MAX_LIST_BYTES = 64 << 20
_BUFFER_BYTES = 1 << 20
_LINE = re.compile(r"([0-9a-fA-F]{64}|[0-9a-fA-F]{128})[ \t]+\*?(.+)")
_ESCAPES = {"%0A": "\n", "%0D": "\r", "%25": "%"}


@dataclass(frozen=True)
class Verification:
    """Result of a verification.

    Attributes
    ----------
    n_files, n_bytes : int
        Files that were compared, and their size.
    changed, missing, added : tuple of str
        Files with another content, files that are gone, and files that no list names.
    info : dict of str to str
        What ``bag-info.txt`` says; only the last of several lines with one label.
    """

    n_files: int
    n_bytes: int
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    added: tuple[str, ...]
    info: dict[str, str]

    @property
    def is_intact(self) -> bool:
        """Whether nothing changed."""
        return not (self.changed or self.missing or self.added)


def verify_package(path: Path, *, should_stop: StopCheck = never_stop) -> Verification:
    """Compare the files of a package with its lists of hashes.

    Parameters
    ----------
    path : Path
        A folder or a zip file.
    should_stop : callable
        See `engine.core.events`.

    Raises
    ------
    FormatError
        When it is no package, or its lists cannot be read, lead out of it or have no SHA-256.
    Cancelled
        When `should_stop` returns True.
    """
    with opened_package(path) as package:
        _require_bag(package)
        algorithm = next((one for one in _ALGORITHMS if f"manifest-{one}.txt" in package.sizes), None)
        if algorithm is None:
            raise FormatError(f"{path} has no list of SHA-256 or SHA-512, so changes cannot be found. Ask for another.")
        expected = _read_list(package, f"manifest-{algorithm}.txt", payload=True)
        tags = f"tagmanifest-{algorithm}.txt"
        listed = {**expected, **(_read_list(package, tags, payload=False) if tags in package.sizes else {})}
        # Without a list of the other files, anything may lie beside `data`.
        covered = "" if tags in package.sizes else "data/"
        known = {*listed, *(f"tagmanifest-{one}.txt" for one in _ALGORITHMS)}
        changed, n_bytes, buffer = [], 0, bytearray(_BUFFER_BYTES)
        for name, digest in listed.items():
            if should_stop():
                raise Cancelled("Stopped. Nothing was changed.")
            if name in package.sizes:
                n_bytes += package.sizes[name]
                if _digest(package, name, algorithm, buffer) != digest:
                    changed.append(name)
        return Verification(
            n_files=sum(name in package.sizes for name in listed),
            n_bytes=n_bytes,
            changed=tuple(changed),
            missing=tuple(sorted(name for name in listed if name not in package.sizes)),
            added=tuple(sorted(name for name in package.sizes if name.startswith(covered) and name not in known)),
            info=_read_info(package),
        )


def _require_bag(package: StoredPackage) -> None:
    if "bagit.txt" not in package.sizes:
        raise FormatError(f"{package.path} is no package: it has no bagit.txt. Choose the folder or zip of a package.")
    lines = _read_text(package, "bagit.txt").splitlines()
    version = re.fullmatch(r"BagIt-Version: *(0\.9[3-7]|1\.\d+)", lines[0].strip()) if lines else None
    encoding = [line.partition(":")[2].strip().upper() for line in lines[1:2]]
    if version is None or encoding != ["UTF-8"]:
        raise FormatError(f"{package.path} is no package that can be read: bagit.txt names no known version in UTF-8.")
    if package.sizes.get("fetch.txt"):
        raise FormatError(f"{package.path} lacks files that fetch.txt says are in the web. Ask for the whole package.")


def _read_list(package: StoredPackage, name: str, *, payload: bool) -> dict[str, str]:
    """Return the hash by file of a manifest."""
    listed: dict[str, str] = {}
    for number, line in enumerate(_read_text(package, name).split("\n"), start=1):
        if not line.strip():
            continue
        found = _LINE.fullmatch(line.rstrip("\r"))
        file = re.sub("%0A|%0D|%25", lambda escape: _ESCAPES[escape[0].upper()], found[2], flags=re.I) if found else ""
        file = file.removeprefix("./")
        if found is None or not is_inner_name(file) or "\\" in file or payload != file.startswith("data/"):
            raise FormatError(
                f"{name} in {package.path} cannot be used: line {number} names no file of the package. Do not use it."
            )
        if listed.setdefault(file, found[1].lower()) != found[1].lower():
            raise FormatError(f"{name} in {package.path} names {file} twice with different hashes. Do not use it.")
    return listed


def _digest(package: StoredPackage, name: str, algorithm: str, buffer: bytearray) -> str:
    digest = hashlib.new(algorithm)
    view = memoryview(buffer)
    with package.reading(name) as stream:
        while count := stream.readinto(buffer):  # type: ignore[attr-defined]
            digest.update(view[:count])
    return digest.hexdigest()


def _read_text(package: StoredPackage, name: str) -> str:
    with package.reading(name) as stream:
        data = stream.read(_MAX_LIST_BYTES + 1)
    if len(data) > _MAX_LIST_BYTES:
        raise FormatError(f"{name} in {package.path} is too large. Do not use this package.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"{name} in {package.path} is not UTF-8 text. Do not use this package.") from error


def _read_info(package: StoredPackage) -> dict[str, str]:
    if "bag-info.txt" not in package.sizes:
        return {}
    pairs = [line.partition(":") for line in _read_text(package, "bag-info.txt").splitlines()]
    return {label.strip(): value.strip() for label, colon, value in pairs if colon}
