"""The offline bundle: one file from which a computer without a network installs the engine.

A zip with ``bundle.json`` (what it is for, and the SHA-256 of each file), ``wheels/`` and ``models/``. It serves one
operating system, processor and version of Python, and can be made on any other.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import EnvironmentProblem, FormatError, HeritageError
from ...core.events import Emit, Progress
from ...core.files import atomic_write, file_sha256, opened, parse_json
from ...core.system import System, package_system, this_system, unsupported
from ..models.catalogue import CATALOGUE
from .locked import locked_arguments, locked_file
from .pip_command import Pip
from .pythons import VERSIONS, usable, version_text
from .target import Target
from .torch_builds import torch_source

_INFO = "bundle.json"
_SCHEMA = {"version": int, "platform": str, "python": str, "torch": str, "files": {str: str}}
_VERSION = 1
_MAX_INFO_BYTES = 1 << 20
_ADVICE = "Copy it again, or ask for another one, which `make offline-bundle` makes."
_CHUNK = 1 << 20


@dataclass(frozen=True)
class Bundle:
    """An offline bundle.

    Attributes
    ----------
    file : Path
    platform : str
        As `system.package_system`.
    python : str
        Version of Python, for example ``3.11``.
    torch : str
        Build of torch.
    files : mapping of str to str
        SHA-256 of each file in it.
    """

    file: Path
    platform: str
    python: str
    torch: str
    files: Mapping[str, str]

    @classmethod
    def read(cls, file: Path) -> Bundle:
        """Return the bundle in `file`; its content is verified by `unpack`.

        Raises
        ------
        FormatError
            When the file is not an offline bundle, or is damaged.
        """
        if not file.is_file():  # opening a named pipe would wait for its other end
            raise FormatError(f"{file} is not a file. Choose the offline bundle.")
        try:
            with zipfile.ZipFile(file) as archive, archive.open(_INFO) as stream:
                text = stream.read(_MAX_INFO_BYTES).decode()
        # zipfile and zlib raise a dozen types for a damaged archive.
        except Exception as error:
            raise FormatError(f"{file} is not an offline bundle of Gaussian Heritage ({error}). {_ADVICE}") from error
        info = parse_json(text, _SCHEMA, source=f"{_INFO} in {file}", advice=_ADVICE)
        if info["version"] != _VERSION:
            raise FormatError(f"{file} was made for another version of Gaussian Heritage. Make it again with this one.")
        return cls(file, info["platform"], info["python"], info["torch"], info["files"])

    def require_this_system(self) -> None:
        """Raise `EnvironmentProblem` when the bundle is for another kind of computer."""
        if self.platform != package_system():
            raise EnvironmentProblem(
                f"{self.file} is for {self.platform}, and this computer is {package_system()}. Choose the bundle "
                "for it, or ask for it: `make offline-bundle SYSTEM=windows`, macos or linux, makes it anywhere."
            )

    def unpack(self, folder: Path, emit: Emit) -> None:
        """Unpack all files into `folder`, verifying each.

        Raises
        ------
        FormatError
            When a file is missing, damaged or not listed.
        DiskError
            When `folder` cannot be written.
        """
        if not self.file.is_file():
            raise FormatError(f"{self.file} is not a file any more. {_ADVICE}")
        try:
            with zipfile.ZipFile(self.file) as archive:
                for number, (name, sha256) in enumerate(self.files.items()):
                    parts = name.split("/")
                    if len(parts) != 2 or parts[0] not in ("wheels", "models") or parts[1] in ("", ".", ".."):
                        raise FormatError(f"{self.file} contains {name!r}, which no bundle has. {_ADVICE}")
                    emit(Progress("unpack", number / len(self.files), message=f"Unpacking {parts[1]}"))
                    with archive.open(name) as stream:
                        self._copy(stream, folder / parts[0] / parts[1], sha256)
        except HeritageError:
            raise
        except Exception as error:
            raise FormatError(f"{self.file} is damaged ({error}). {_ADVICE}") from error

    def _copy(self, stream: Any, target: Path, sha256: str) -> None:
        digest = hashlib.sha256()
        with atomic_write(target) as out:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
                out.write(chunk)
            if digest.hexdigest() != sha256:
                raise FormatError(f"{self.file} is damaged: {target.name} has another SHA-256. {_ADVICE}")


def write_bundle(
    out: Path,
    python: Path,
    models: Path,
    build: str,
    emit: Emit,
    *,
    system: System | None = None,
    version: str | None = None,
) -> Bundle:
    """Write a bundle for computers like this one, or for another system.

    Parameters
    ----------
    out : Path
        Zip file; replaced if it exists.
    python : Path
        A Python with pip.
    models : Path
        Folder with the model files, as `models.models_folder`.
    build : {"cpu", "cuda"}
        Build of torch.
    system : System, optional
        What the bundle is for; by default, this computer.
    version : str, optional
        Version of Python that the bundle is for, for example "3.11"; by default, that of `python`.

    Raises
    ------
    EnvironmentProblem
        When a package cannot be downloaded, or this computer is none that the engine runs on and `system` is not given.
    DiskError
        When `out` or the folder for temporary files cannot be written.
    """
    interpreter = usable(python)
    if interpreter is None:
        raise EnvironmentProblem(f"{python} cannot be used: the engine needs a 64-bit CPython 3.11, 3.12 or 3.13.")
    system, version = system or this_system(), version or version_text(interpreter.version)
    if system is None:
        raise EnvironmentProblem(unsupported())
    if version not in map(version_text, VERSIONS):
        raise EnvironmentProblem(f"The engine has no packages for Python {version}. Choose 3.11, 3.12 or 3.13.")
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-bundle-") as name:
        wheels, target = Path(name) / "wheels", Target(system, version)
        pip = Pip(python, Path(name) / "pip.log")
        emit(Progress("bundle", 0.0, message=f"Downloading the packages for {system.title}, Python {version}"))
        for part in ("engine", "pip"):
            # pip evaluates conditions for the Python that it runs in.
            chosen = Path(name) / f"{part}.txt"
            chosen.write_text(target.requirements(locked_file(part)), encoding="utf-8")
            pip.download([*target.arguments, *locked_arguments(chosen)], wheels)
        source = torch_source(pip, build, target)
        emit(Progress("bundle", 0.4, message=f"Downloading {source.what}"))
        pip.download(source.arguments, wheels, one_index=source.one_index)
        content = {f"wheels/{file.name}": file for file in sorted(wheels.iterdir())}
        content |= {f"models/{model.file}": models / model.file for model in CATALOGUE.values() if not model.optional}
        missing = [file.name for file in content.values() if not file.is_file()]
        if missing:
            raise EnvironmentProblem(f"{', '.join(missing)} is not in {models}. Run: python -m engine models fetch")
        hashes = {key: file_sha256(file) for key, file in content.items()}
        info = {
            "version": _VERSION, "platform": system.packages, "python": version,
            "torch": source.build, "files": hashes,
        }  # fmt: skip
        with atomic_write(out) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
            archive.writestr(_entry(_INFO), json.dumps(info, indent=1))
            for number, (key, file) in enumerate(content.items()):
                emit(Progress("bundle", 0.7 + 0.3 * number / len(content), message=f"Packing {file.name}"))
                entry = _entry(key)
                entry.file_size = file.stat().st_size  # decides whether the entry can have 4 GB
                with opened(file, advice=_ADVICE) as unpacked, archive.open(entry, "w") as packed:
                    shutil.copyfileobj(unpacked, packed, _CHUNK)
    return Bundle.read(out)


def _entry(name: str) -> zipfile.ZipInfo:
    """Return the entry of a file without the time and mode of this computer: equal files make equal bundles."""
    entry = zipfile.ZipInfo(name)
    entry.external_attr = 0o644 << 16
    entry.create_system = 3
    return entry
