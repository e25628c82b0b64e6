"""Where a folder has the cameras that other programs wrote: COLMAP models, ``transforms.json`` and other exports."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..core.errors import CameraError, FormatError
from ..core.files import opened

_MODEL_FILES = ("cameras.bin", "cameras.txt")
_PLACES = ("", "sparse", "colmap/sparse", "colmap", "distorted/sparse", "distorted", "dense/sparse", "dense")
"""Where programs put models in a project, the usual places first. Each may hold a model or numbered sub-models."""
_NUMBERED_PLACES = ("dense/*/sparse",)
_MAX_PARTS = 100
"""Sub-models of one place that are read."""
_MAX_FILES = 20_000
"""Files that are looked at for cameras: more are no folder of cameras."""
_HEAD_BYTES = 65_536
"""Bytes of a file that its kind is told from."""
_SUFFIXES = {".json", ".xml", ".csv", ".txt", ".xmp", ".out"}
_KNOWN = (
    "Choose a COLMAP model folder (cameras.bin, images.bin, points3D.bin), a transforms.json, the cameras that "
    "Metashape exports as XML, or those that RealityCapture or RealityScan exports as CSV or XMP; other programs can "
    "export a COLMAP model."
)

Kind = Literal["transforms", "metashape", "csv", "xmp", "bundler"]


@dataclass(frozen=True)
class ModelPlace:
    """A place with a COLMAP model.

    Attributes
    ----------
    parts : tuple of Path
        Folders of its sub-models, at least one.
    base : Path
        Folder that belongs to the model; photos in it are more likely to be the model's.
    """

    parts: tuple[Path, ...]
    base: Path


@dataclass(frozen=True)
class Export:
    """Cameras in files of another program.

    Attributes
    ----------
    kind : Kind
    files : tuple of Path
        At least one; more than one for ``xmp`` only.
    """

    kind: Kind
    files: tuple[Path, ...]


def find_models(model: Path) -> list[ModelPlace]:
    """Return the places in the folder `model` that have COLMAP models, the usual ones first; empty for a file.

    Parameters
    ----------
    model : Path
        A folder with a model, one of its sub-models, or the folder of a project that has a model in a usual place.
    """
    places = []
    if not model.is_dir():
        return []
    numbered = itertools.chain.from_iterable(sorted(model.glob(pattern)) for pattern in _NUMBERED_PLACES)
    for folder in (*(model / place for place in _PLACES), *numbered):
        if _is_model(folder):
            parts: tuple[Path, ...] = (folder,)
        else:
            parts = tuple(_numbered_models(folder))[:_MAX_PARTS]
        if parts:
            places.append(ModelPlace(parts, _base(folder, model)))
    return places


def files_of_model(model: Path) -> list[Path]:
    """Return the files that given cameras are read from, in order; the cameras change only when one of them does.

    Raises
    ------
    CameraError, FormatError
        As `find_export`.
    """
    if model.is_file():
        return [model]
    parts = [part for place in find_models(model) for part in place.parts]
    if parts:
        return sorted(path for part in parts for path in part.iterdir() if path.is_file())
    files = find_export(model).files
    # A point cloud is in the folder of its transforms.json.
    clouds = {path for file in files for path in file.parent.glob("*.ply")}
    return sorted({*files, *clouds})


def _is_model(folder: Path) -> bool:
    """Return whether a folder has a model's file of cameras; what it lacks besides is reported on reading."""
    return any((folder / name).is_file() for name in _MODEL_FILES)


def _numbered_models(folder: Path) -> Iterator[Path]:
    if folder.is_dir():
        named = [path for path in folder.iterdir() if path.name.isascii() and path.name.isdecimal()]
        yield from (path for path in sorted(named, key=lambda path: int(path.name)) if _is_model(path))


def _base(folder: Path, model: Path) -> Path:
    """Return the folder that belongs to the model in `folder`: that above ``sparse``, unless `model` is itself one."""
    return folder.parent if folder.name == "sparse" and folder != model else folder


def find_export(model: Path) -> Export:
    """Return the cameras that other programs than COLMAP wrote to a file or a folder.

    Parameters
    ----------
    model : Path
        A file, whose kind is found by its content; or a folder with one such file, or with one XMP file per photo.

    Raises
    ------
    CameraError
        When nothing is there, no known kind of cameras is there, or a folder has several files with cameras.
    FormatError
        When a file cannot be opened.
    """
    if model.is_file():
        # Any JSON that was chosen is read as transforms.json, whose reader says what is wrong with it.
        chosen = _kind_of(model) or ("transforms" if model.suffix.lower() == ".json" else None)
        if chosen is None:
            raise CameraError(f"{model} holds no cameras of a known kind. {_KNOWN}")
        return Export(chosen, (model,))
    if not model.exists():
        raise CameraError(f"The camera model {model} does not exist. Choose a COLMAP model folder or transforms.json.")
    found: dict[Kind, list[Path]] = {}
    for file in _candidates(model):
        try:
            kind = _kind_of(file)
        except FormatError:
            continue
        if kind is not None:
            found.setdefault(kind, []).append(file)
    if not found:
        raise CameraError(f"{model} contains no camera model. {_KNOWN}")
    if "transforms" in found:
        # nerfstudio writes it beside what it was made from.
        found = {"transforms": found["transforms"]}
    found = {kind: files if kind == "xmp" else [_the_one(model, files)] for kind, files in found.items()}
    if len(found) > 1:
        (first, *_), (second, *_) = list(found.values())[:2]
        raise CameraError(f"{model} has cameras of two programs: {first.name} and {second.name}. Choose one of them.")
    ((found_kind, files),) = found.items()
    return Export(found_kind, tuple(files))


def _the_one(model: Path, files: list[Path]) -> Path:
    """Return the only file of a kind, or ``transforms.json``; ``transforms_train.json`` and others are parts of it."""
    named = [file for file in files if file.name == "transforms.json"]
    if len(files) > 1 and len(named) != 1:
        raise CameraError(
            f"{model} has several files with cameras: {files[0].name} and {files[1].name}. Choose one of them."
        )
    return (named if len(files) > 1 else files)[0]


def _candidates(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that may hold cameras, and the XMP files below it."""
    count = 0
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            suffix = Path(name).suffix.lower()
            if suffix in _SUFFIXES and (suffix == ".xmp" or Path(parent) == folder):
                count += 1
                if count > _MAX_FILES:
                    raise CameraError(f"{folder} has more than {_MAX_FILES:,} files. Choose the folder of the cameras.")
                yield Path(parent, name)


def _kind_of(file: Path) -> Kind | None:
    """Return the kind of cameras in a file by its content; None for anything else."""
    with opened(file, advice="Check its permissions.") as stream:
        head = stream.read(_HEAD_BYTES)
    text = head.decode("utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8", errors="replace").lstrip(
        "\ufeff"
    )
    start = text.lstrip()
    if file.name == "transforms.json" or (start.startswith("{") and '"frames"' in text):
        return "transforms"
    if start.startswith("<"):  # XML: XMP of RealityCapture, or the cameras or the project of Metashape
        if "capturingreality.com" in text:
            return "xmp" if "FocalLength35mm" in text else None
        is_metashape = "<chunk" in text or ("<document" in text and "<sensors" in text)
        return "metashape" if is_metashape else None
    if start.startswith("# Bundle file"):
        return "bundler"
    # RealityCapture writes "#cameras 48" before the names of the columns, which are places in a scene or on a map.
    header = next((line for line in text.splitlines() if line.strip() and not line.startswith("#cameras")), "")
    columns = {column.strip().lower().lstrip("#") for column in header.split(",")}
    return "csv" if {"name", "x", "y"} <= columns or {"name", "lat"} <= columns else None
