"""RO-Crate metadata of a package: its files, and the steps that made them, in the terms of schema.org."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core.files import file_sha256
from ...formats import FORMATS

CRATE_FILE = "ro-crate-metadata.json"
_MEDIA_TYPES = {
    **{suffix: kind.media_type for kind in FORMATS for suffix in kind.suffixes},
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".png": "image/png",
    ".webm": "video/webm",
    ".mp4": "video/mp4",
    ".xml": "application/xml",
    ".json": "application/json",
    ".jsonld": "application/ld+json",
    ".txt": "text/plain",
}


def media_type(path: Path) -> str:
    """Return the media type of a file of a package by its suffix."""
    return _MEDIA_TYPES.get(path.suffix.lower(), "application/octet-stream")


def write_crate(folder: Path, described: dict[str, Any], notes: dict[str, str]) -> None:
    """Write ``ro-crate-metadata.json`` for the files of a folder.

    Parameters
    ----------
    folder : Path
        Has all files of the crate.
    described : dict
        The record, as `describe_scene` or `describe_object` return it.
    notes : dict of str to str
        What each file is, by its path in the folder.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    from rocrate.model import ContextEntity
    from rocrate.rocrate import ROCrate

    crate = ROCrate()
    item, exported = described.get("object") or {}, described["exported"]
    crate.name = described["title"]
    crate.description = item.get("notes") or (
        f"{'An object' if item else 'A scene'} as 3D Gaussian splats, reconstructed from photographs."
    )
    crate.datePublished = exported["finished"]
    if item.get("rights"):
        crate.root_dataset["copyrightNotice"] = item["rights"]
    identifiers = [value for value in (item.get("catalogue_number"), described["identifier"]) if value]
    if identifiers:
        crate.root_dataset["identifier"] = identifiers
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name != CRATE_FILE:
            properties = {
                "name": notes.get(name, path.name),
                "encodingFormat": media_type(path),
                "contentSize": str(path.stat().st_size),
                "sha256": file_sha256(path),
            }
            crate.add_file(dest_path=name, properties=properties)
    for step in described["steps"]:
        programs = [
            crate.add(
                ContextEntity(
                    crate,
                    f"#{name.replace(' ', '-')}-{version}",
                    {"@type": "SoftwareApplication", "name": name, "softwareVersion": version},
                )
            )
            for name, version in (step["software"] or {}).items()
        ]
        action: dict[str, Any] = {
            "@type": "CreateAction",
            "name": step["what"],
            "instrument": [program for program in programs if program is not None],
            "description": ", ".join(f"{name}: {value}" for name, value in step["results"].items()),
        }
        if step["finished"]:
            action["endTime"] = step["finished"]
        crate.root_dataset.append_to("mentions", crate.add(ContextEntity(crate, f"#step-{step['stage']}", action)))
    crate.metadata.write(folder)
