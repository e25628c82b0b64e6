"""Kept rooms: a trained choosing room with its photos and ground truth in one small archive.

What can be made again is left out: embeddings, checkpoints, logs, reports. The Gaussians are rounded, because zero bits
take no space in the archive; docs/design_notes/kept_rooms.md tells what that changes.
"""

from __future__ import annotations

import io
import lzma
import os
import shutil
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.core.errors import DiskError, FormatError, ProjectError
from engine.core.files import TEMPORARY_PREFIX, atomic_write, delete_derived, is_inner_name, path_within, read_bytes
from engine.core.system import CODE_ROOT
from engine.masks import read_label_map
from engine.project.folder import PROJECT_FILE, ProjectFolder
from engine.scene import Gaussians, read_photo_set, write_photo_set
from engine.training import FEATURES_FILE, SCENE_FILE, load_gaussians, save_gaussians

from .draws import KEPT_ROOMS, Room
from .results import SHORT

KEPT_FOLDER = Path(KEPT_ROOMS)
"""Relative to the repository."""

_STAGES = ("photos", "cameras", "masks", "training")
_PARTS = ("photos", "truth", "project")
_BINARY_PLACES = {"means": 10, "log_scales": 4, "quats": 5, "opacity_logits": 4, "sh": 4, "features": 3}
"""Binary places behind the point that are kept; a number changes by at most half of the last one."""
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 2, "pb": 2}]
"""Options for tables of numbers of 4 bytes."""
_MAX_ARCHIVE = 8 << 20
_MAX_UNPACKED = 64 << 20
_MAX_FILES = 1000
_MEMORY = 256 << 20
"""Largest memory of the decompressor, bytes."""
_ADVICE = "Restore it with git."


def pack_room(repository: Path, room: Room, commit: str) -> int:
    """Pack a choosing room that was trained with the method of `commit`, and return the size of the archive in bytes.

    Raises
    ------
    ProjectError
        When the room is not trained yet.
    FormatError
        When a file of the project is damaged.
    DiskError
        When the archive cannot be written.
    """
    source = repository / "out" / "rooms" / room.name
    project = ProjectFolder.open_existing(source / commit[:SHORT] / "project")
    if project.stage_record("training") is None:
        raise ProjectError(f"{project.path} is not trained. Run `make test-rooms` first.")
    project.require_intact(*_STAGES)
    archive = repository / KEPT_FOLDER / f"{room.name}.tar.xz"
    with tempfile.TemporaryDirectory() as name:
        staged = Path(name)
        _copy_project(project, staged / "project")
        files = {
            f"project/{path.relative_to(staged / 'project').as_posix()}": path for path in _files(staged / "project")
        }
        for part in ("photos", "truth"):
            files |= {f"{part}/{path.relative_to(source / part).as_posix()}": path for path in _files(source / part)}
        with atomic_write(archive) as stream:
            stream.write(lzma.compress(_tar(files), filters=_FILTERS))
    return archive.stat().st_size


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.is_file() and not path.is_symlink())


def _tar(files: dict[str, Path]) -> bytes:
    """Return a tar of the files by name, without owners and times: the same files make the same bytes."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:", format=tarfile.USTAR_FORMAT) as tar:
        for name, path in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = path.stat().st_size
            with path.open("rb") as stream:
                tar.addfile(entry, stream)
    return buffer.getvalue()


def _copy_project(project: ProjectFolder, target: Path) -> None:
    """Copy what prompts need of a project, with rounded Gaussians and their hashes."""
    outputs = {stage: list(project.recorded_outputs(stage)) for stage in _STAGES}
    for name in (PROJECT_FILE, *(name for names in outputs.values() for name in names)):
        path = path_within(project.path, *PurePosixPath(name).parts)
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        if name in outputs["masks"]:
            _copy_label_map(path, target / name)
        else:
            shutil.copyfile(path, target / name)
    gaussians = load_gaussians(project.path / "gaussians")
    save_gaussians(target / "gaussians", rounded_gaussians(gaussians))
    copied = ProjectFolder.open_existing(target)
    copied.record_outputs("masks", [target / name for name in outputs["masks"]])
    copied.record_outputs("training", [target / "gaussians" / name for name in (SCENE_FILE, FEATURES_FILE)])
    _place_photos(copied, Path("photos"))


def _place_photos(project: ProjectFolder, photos: Path) -> None:
    """Write the folder of the photos into a project: an archive names none of the machine that packed it."""
    listing = project.path / "photos" / "photos.json"
    write_photo_set(listing, replace(read_photo_set(listing), folder=photos))
    project.record_outputs("photos", [listing])
    project.put("photo_folder", str(photos))


def _copy_label_map(source: Path, target: Path) -> None:
    """Copy a label map without compression, so that the archive as a whole compresses it better."""
    read_label_map(source)
    with np.load(source) as arrays, target.open("wb") as stream:
        np.savez(stream, **{name: arrays[name] for name in arrays.files})


def rounded_gaussians(gaussians: Gaussians) -> Gaussians:
    """Return Gaussians whose numbers are rounded to the binary places of a kept room."""
    values = {name: (getattr(gaussians, name), places) for name, places in _BINARY_PLACES.items()}
    changed: dict[str, Any] = {name: rounded(*one) for name, one in values.items() if one[0] is not None}
    return replace(gaussians, **changed)


def rounded(values: NDArray[np.float32], places: int) -> NDArray[np.float32]:
    """Return finite numbers rounded to multiples of 2^-places; their other bits are zero, which take no space."""
    return (np.round(values.astype(np.float64) * 2.0**places) / 2.0**places).astype(np.float32)


def unpack_room(archive: Path, out: Path) -> Path:
    """Unpack a kept room into a new folder and return its project folder. After a kill there is no `out`.

    Parameters
    ----------
    archive : Path
    out : Path
        Must not exist; gets ``photos``, ``truth`` and ``project``.

    Raises
    ------
    ProjectError
        When `out` exists.
    FormatError
        When the archive is damaged, or holds a link or a name that leads out of the folder.
    DiskError
        When the folder cannot be written.
    """
    if out.exists() or out.is_symlink():
        raise ProjectError(f"{out} exists already. Choose a new folder.")
    content = _decompressed(archive)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(prefix=TEMPORARY_PREFIX, dir=out.parent))
    except OSError as error:
        raise DiskError(f"{out} cannot be written: {error.strerror or error}. Choose another folder.") from error
    try:
        _extract(content, new, archive)
        project = ProjectFolder.open_existing(new / "project")
        project.require_intact(*_STAGES)
        _place_photos(project, (out / "photos").resolve())
        new.chmod(0o755)
        os.replace(new, out)
    except OSError as error:
        raise DiskError(f"{out} cannot be written: {error.strerror or error}. Choose another folder.") from error
    finally:
        delete_derived(out.parent, new.name)
    return out / "project"


def unpack_kept(name: str, out: Path) -> Path:
    """Unpack the kept room of this repository that has this name, as `unpack_room` does."""
    return unpack_room(CODE_ROOT / KEPT_FOLDER / f"{name}.tar.xz", out)


def _decompressed(archive: Path) -> bytes:
    data = read_bytes(archive, max_bytes=_MAX_ARCHIVE, advice=_ADVICE)
    try:
        decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MEMORY)
        content = decompressor.decompress(data, max_length=_MAX_UNPACKED)
    except (lzma.LZMAError, EOFError) as error:
        raise FormatError(f"{archive} cannot be unpacked: {error}. {_ADVICE}") from error
    if not decompressor.eof:
        raise FormatError(f"{archive} cannot be unpacked: it is cut off or too large. {_ADVICE}")
    return content


def _extract(content: bytes, folder: Path, archive: Path) -> None:
    """Write the files of a tar into an empty folder."""
    try:
        with tarfile.open(fileobj=io.BytesIO(content), mode="r:") as tar:
            names: set[str] = set()
            for entry in tar:
                _require_harmless(entry, names, archive)
                names.add(entry.name)
                target = path_within(folder, *PurePosixPath(entry.name).parts)
                target.parent.mkdir(parents=True, exist_ok=True)
                stream = tar.extractfile(entry)
                assert stream is not None
                with target.open("xb") as written:
                    shutil.copyfileobj(stream, written)
    except (tarfile.TarError, EOFError, ValueError, UnicodeError) as error:
        raise FormatError(f"{archive} cannot be unpacked: {error}. {_ADVICE}") from error


def _require_harmless(entry: tarfile.TarInfo, before: set[str], archive: Path) -> None:
    problem = ""
    if not entry.isreg():
        problem = "is no regular file"
    elif not is_inner_name(entry.name) or PurePosixPath(entry.name).parts[0] not in _PARTS:
        problem = "leads out of the folder of the room"
    elif entry.name in before or any(parent.as_posix() in before for parent in PurePosixPath(entry.name).parents):
        problem = "is there twice"
    elif len(before) >= _MAX_FILES:
        problem = "is one file too many"
    if problem:
        raise FormatError(f"{archive} is not used: {entry.name[:100]!r} in it {problem}. {_ADVICE}")
