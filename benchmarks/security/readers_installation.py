"""Readers of the engine's installation: the offline bundle, and the record of what is installed."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path

from .reader import Reader

_WHEEL = b"a wheel" * 20


def _write_bundle(folder: Path) -> None:
    from engine.core.system import package_system

    files = {"wheels/one-1.0-py3-none-any.whl": _WHEEL, "models/one.onnx": b"weights"}
    info = {
        "version": 1, "platform": package_system(), "python": "3.11", "torch": "cpu",
        "files": {name: hashlib.sha256(content).hexdigest() for name, content in files.items()},
    }  # fmt: skip
    with zipfile.ZipFile(folder / "bundle.zip", "w") as archive:
        archive.writestr("bundle.json", json.dumps(info))
        for name, content in files.items():
            archive.writestr(name, content)


def _unpack_bundle(folder: Path) -> object:
    from engine.core.events import ignore_events
    from engine.install.environment.bundle import Bundle

    Bundle.read(folder / "bundle.zip").unpack(folder / "unpacked", ignore_events)
    return True


def _write_installed(folder: Path) -> None:
    from engine.install.environment import EngineEnvironment

    engine = EngineEnvironment(folder)
    engine.begin()
    engine.python.parent.mkdir(parents=True)
    engine.python.touch()
    engine.finish("3.11", "cpu")


def _installed_state(folder: Path) -> object:
    from engine.install.environment import EngineEnvironment

    return EngineEnvironment(folder).state() == "ready" or None


INSTALLATION: tuple[Reader, ...] = (
    Reader("offline-bundle", _write_bundle, _unpack_bundle, ("bundle.zip",)),
    Reader("installed-engine", _write_installed, _installed_state, ("installed.json",)),
)
