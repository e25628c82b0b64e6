"""The locked requirements: each package that the engine needs, its version, and the SHA-256 of its files on PyPI."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path


def locked_file(name: str) -> Path:
    """Return ``locked-<name>.txt``: "engine", "torch", "pip" or "cuda" (what only CUDA builds of torch need)."""
    return Path(__file__).with_name(f"locked-{name}.txt")


def pinned(file: Path) -> str:
    """Return name and version of the only package of a locked file, for example ``torch==2.13.0``."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return next(line for line in lines if "==" in line).rstrip(" \\")


def pins_in(file: Path) -> list[str]:
    """Return the names of the packages in a locked file."""
    return re.findall(r"^([\w.-]+)==", file.read_text(encoding="utf-8"), re.MULTILINE)


def hashes_in(file: Path) -> set[str]:
    """Return all SHA-256 in a locked file."""
    return set(re.findall(r"--hash=sha256:(\w+)", file.read_text(encoding="utf-8")))


def locked_arguments(file: Path) -> list[object]:
    """Return pip's arguments to install a locked file: nothing that is not in it, and only what has its hash."""
    return ["--require-hashes", "--no-deps", "--only-binary", ":all:", "--requirement", file]


def fingerprint(python: str, build: str, files: list[Path]) -> str:
    """Return the hash of all that decides what is installed: version of Python, build of torch, locked files."""
    digest = hashlib.sha256(repr((python, build)).encode())
    for file in files:
        # Read as text, because line ends differ between checkouts on Windows and elsewhere.
        digest.update(file.read_text(encoding="utf-8").encode())
    return digest.hexdigest()
