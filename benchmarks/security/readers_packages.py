"""Readers of packages, of the EXIF facts of photos, and of what records are made of."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

from .reader import Reader
from .readers_project import write_object, write_project

_CONTENT = {"data/vase.ply": b"ply\n" * 20, "data/records/lido.xml": b"<lido/>\n"}


def _write_bag(folder: Path) -> None:
    """Write a package with two files."""
    tags = {
        "bagit.txt": b"BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n",
        "bag-info.txt": b"Bagging-Date: 2026-01-01\nPayload-Oxum: 88.2\n",
        "manifest-sha256.txt": _manifest(_CONTENT),
    }
    for name, data in {**_CONTENT, **tags, "tagmanifest-sha256.txt": _manifest(tags)}.items():
        path = folder / "bag" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _manifest(files: dict[str, bytes]) -> bytes:
    return "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in files.items()).encode()


def _write_zip(folder: Path) -> None:
    from engine.core.files import write_zip

    _write_bag(folder)
    stream = io.BytesIO()
    write_zip(stream, folder / "bag", name="bag")
    (folder / "bag.zip").write_bytes(stream.getvalue())


def _verify(path: Path) -> object:
    """Verify a package, and refuse one that changed, as the command does."""
    from engine.core.errors import FormatError
    from engine.delivery.packages import verify_package

    found = verify_package(path)
    if not found.is_intact:
        raise FormatError("The package is not as it was made.")
    return found


def _write_photo(folder: Path) -> None:
    from PIL import Image

    image = Image.new("RGB", (64, 48), (90, 60, 30))
    exif = image.getexif()
    exif[0x010F], exif[0x0110] = "Acme", "Phone 3"
    camera = exif.get_ifd(0x8769)
    camera[0x9003], camera[0x829A], camera[0x8827] = "2026:05:01 10:20:30", 0.005, 200
    image.save(folder / "photo.jpg", exif=exif)


def _read_facts(folder: Path) -> object:
    from engine.photos import exif_facts

    return exif_facts(folder / "photo.jpg")


def _write_record(folder: Path) -> None:
    from engine.project.objects import MuseumRecord, save_record
    from engine.scene import Photo, PhotoSet, write_photo_set

    write_project(folder)
    write_object(folder)
    save_record(folder, "vase", MuseumRecord("1906.12", "Vase", "CC BY", "notes"))
    photos = tuple(Photo(name, 160, 120, 140.0, "ab" * 32) for name in ("a.jpg", "b.jpg"))
    write_photo_set(folder / "photos" / "photos.json", PhotoSet(Path("photos"), photos, ()))


def _read_record(folder: Path) -> object:
    """Make every form of a record."""
    from engine.delivery import records
    from engine.project.folder import ProjectFolder

    described = records.describe_object(ProjectFolder.open_existing(folder), "vase")
    return (
        records.crm_json_ld(described),
        records.dublin_core_xml(described),
        records.record_summary(described, frame="upright"),
        records.iiif_manifest(described, [], address=records.EXAMPLE_ADDRESS, name="manifest.json"),
        records.lido_xml(described),
        records.ply_comments(records.record_summary(described, frame="upright")),
        records.xmp_packet(described),
    )


PACKAGES: tuple[Reader, ...] = (
    Reader(
        "package",
        _write_bag,
        lambda folder: _verify(folder / "bag"),
        ("bag/bagit.txt", "bag/bag-info.txt", "bag/manifest-sha256.txt", "bag/tagmanifest-sha256.txt"),
    ),
    Reader("package-zip", _write_zip, lambda folder: _verify(folder / "bag.zip"), ("bag.zip",), share=2.0),
    Reader("exif-facts", _write_photo, _read_facts, ("photo.jpg",)),
    Reader(
        "record",
        _write_record,
        _read_record,
        ("project.json", "objects/vase/object.json", "objects/vase/record.json", "photos/photos.json"),
    ),
)
