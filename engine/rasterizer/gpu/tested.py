"""Cards that passed their self-test: in another process of the same run, or in an earlier run of the same code.

A pass is kept as an empty file, named by the hash of what it depends on: the card with its driver and limits, wgpu, and
the code of the rasterizer. A file of another name says nothing, so nothing is read.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
from pathlib import Path

from platformdirs import user_cache_path

from ...core.errors import DiskError
from ...core.files import delete_derived, file_sha256

_PASSED: set[str] = set()
_PACKAGE = Path(__file__).resolve().parents[1]
_KINDS = (".py", ".wgsl")


def passed_elsewhere(card: str) -> None:
    """Take a card, by its name with its interface as in `Device.name`, for tested in this process."""
    _PASSED.add(card)


def has_passed_elsewhere(card: str) -> bool:
    """Return whether a card, by the same name, was tested."""
    return card in _PASSED


def passed_before(description: str) -> bool:
    """Return whether a card, by its line of `describe_adapters`, passed in an earlier run of this code."""
    return _mark(description).exists()


def keep_pass(description: str) -> None:
    """Keep that a card passed. Where that cannot be stored, the next run tests again."""
    with contextlib.suppress(OSError):
        _folder().mkdir(parents=True, exist_ok=True)
        _mark(description).touch()


def forget_passes() -> None:
    """Let the next run test every card: one failed, or is to be tested."""
    with contextlib.suppress(OSError, DiskError):
        delete_derived(_folder().parent, _folder().name)


def _folder() -> Path:
    return user_cache_path("gaussian-heritage", appauthor=False) / "cards"


def _mark(description: str) -> Path:
    digest = hashlib.sha256(f"{description}\n{importlib.metadata.version('wgpu')}\n".encode())
    for file in sorted(file for file in _PACKAGE.rglob("*") if file.suffix in _KINDS):
        digest.update(file_sha256(file).encode())
    return _folder() / digest.hexdigest()[:32]
