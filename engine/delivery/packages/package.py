"""One package for an object or a scene: its files in open formats, its records and its pictures, as a BagIt bag."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from ...core.errors import ObjectError, ProjectError
from ...core.events import StopCheck, never_stop
from ...core.files import (
    TEMPORARY_PREFIX,
    atomic_write,
    delete_derived,
    finite_or_null,
    path_within,
    write_file,
    write_json,
    write_problem,
    write_zip,
)
from ...core.language import languages
from ...core.system import replace_file
from ...formats import FORMATS, format_of
from ...meshing.settings import MeshSettings
from ...project.content import report_file
from ...project.folder import ProjectFolder
from ...project.objects import new_id
from ...rasterizer.settings import Backend
from ..records import EXAMPLE_ADDRESS, Picture, crm_json_ld, dublin_core_xml, iiif_manifest, lido_xml
from .bag import PAYLOAD, write_bag
from .captures import add_exif, photo_file
from .crate import media_type, write_crate
from .exporting import Export, divided, load_export, mesh_of, turn_of, write_export, write_mesh_export
from .page import is_viewer_built
from .turntable import SHEET, Turn, write_films, write_sheet

_PICTURES = "pictures"
_RECORDS = "records"
_FROM_RECORDS = "../"
"""The way from a record to the files of the package, which links name until they have an address."""
_IIIF = "iiif/manifest.json"
_IIIF_EVERY = 2
"""Every so many pictures of a turn are stored as files, which a IIIF viewer turns."""
_QUALITY = 90
_MESH = "glb-mesh"
_MESH_NOTE = "a mesh of it with a texture from the photos, for programs that know no Gaussians (glTF, Y up)"
_NOTES = {
    "ro-crate-metadata.json": "this package described for programs (RO-Crate)",
    f"{_RECORDS}/paradata.json": "everything that is known of how it was made",
    f"{_RECORDS}/provenance.jsonld": "the same in the terms of CIDOC CRM and CRMdig (JSON-LD)",
    f"{_RECORDS}/dublin_core.xml": "Dublin Core",
    f"{_RECORDS}/lido.xml": "LIDO 1.1, for museum databases and portals",
    _IIIF: "IIIF Presentation 3 manifest of the pictures",
    f"{_PICTURES}/{SHEET}": "twelve views on one sheet",
    f"{_PICTURES}/turntable.webm": "a film of all views, for browsers (WebM, VP8)",
    f"{_PICTURES}/turntable.mp4": "the same film, for other programs (MP4, MPEG-4)",
}


def _mesh_name(stem: str) -> str:
    """Return the name of the file with the mesh; that of the Gaussians has the same suffix."""
    return f"{stem}_mesh{format_of(_MESH).suffixes[0]}"


def package_name(export: Export) -> str:
    """Return the name of the folder of a package: the object's id, or one made from the title of the scene."""
    item = export.described.get("object")
    return str(item["id"]) if item else new_id(export.described["title"], ())


def write_package(
    out: Path,
    project: ProjectFolder,
    name: str | None,
    *,
    address: str,
    title: str | None = None,
    overwrite: bool = False,
    as_zip: bool = False,
    with_photos: bool = False,
    with_mesh: bool = False,
    backend: Backend = "cpu",
    should_stop: StopCheck = never_stop,
) -> Path:
    """Write the package of the scene (None) or of the object called `name`, and return its path.

    Parameters
    ----------
    out : Path
        Folder in which the package is written, as a folder or a zip file called after the object.
    address : str
        Where the content of the package's ``data`` is, or will be, published, for IIIF and LIDO: ``https://.../``.
    title : str, optional
        Title of the scene; by default its photos' folder names it.
    overwrite : bool
        Whether a package of the same name is replaced. Nothing else is.
    with_photos : bool
        Whether the photos that were used are in the package.
    with_mesh : bool
        Whether a textured mesh of the object is in the package. The scene has none.
    backend : {"cpu", "gpu", "reference"}
        Rasterizer of the pictures.
    should_stop : callable
        See `engine.core.events`.

    Raises
    ------
    ProjectError
        When there is something of that name which may not be replaced, or a photo that is wanted changed or is missing.
    HeritageError
        When the object does not exist, a part of the project is damaged, or a file cannot be written.
    """
    export = load_export(project, name, title=title)
    if len(export.gaussians) == 0:
        raise ObjectError(
            f"{export.described['title']} has no Gaussians, so there is nothing to keep. Isolate it again."
        )
    add_exif(project, export.described)
    stem = package_name(export)
    target = out / (f"{stem}.zip" if as_zip else stem)
    _require_free(target, overwrite=overwrite)
    with _new_folder(out) as made:
        data = made / PAYLOAD
        data.mkdir()
        if with_mesh:
            made_mesh = mesh_of(project, export, MeshSettings(), backend=backend, should_stop=should_stop)
            write_mesh_export(data / _mesh_name(stem), export, made_mesh, _MESH, frame="upright")
        _fill(data, stem, project, export, address, with_photos=with_photos, backend=backend, should_stop=should_stop)
        item = export.described.get("object") or {}
        info = {"External-Description": f"{export.described['title']}: 3D Gaussian splats with records"}
        if item.get("catalogue_number"):
            info["External-Identifier"] = item["catalogue_number"]
        write_bag(made, info)
        if as_zip:
            packed = [suffix for kind in FORMATS if kind.is_packed for suffix in kind.suffixes]
            with atomic_write(target) as stream:
                write_zip(stream, made, name=stem, packed=packed)
        else:
            delete_derived(out, stem)
            replace_file(made, target)
    return target


def _require_free(target: Path, *, overwrite: bool) -> None:
    if not target.exists():
        return
    if not overwrite:
        raise ProjectError(f"{target} already exists. Choose another folder or add --overwrite.")
    is_package = target.suffix == ".zip" or (target / "bagit.txt").is_file()
    if target.is_symlink() or not is_package:
        raise ProjectError(f"{target} is no package, so it is not replaced. Choose another folder with --out.")


@contextlib.contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """Yield an empty folder below `out` that is deleted when the block ends, unless the block moved it away."""
    made = out / f"{TEMPORARY_PREFIX}package-{os.getpid()}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        made.mkdir()
        yield made
    except OSError as error:
        raise write_problem(out, error) from error
    finally:
        delete_derived(out, made.name)


def _fill(
    data: Path,
    stem: str,
    project: ProjectFolder,
    export: Export,
    address: str,
    *,
    with_photos: bool,
    backend: Backend,
    should_stop: StopCheck,
) -> None:
    described, notes = export.described, {**_NOTES, _mesh_name(stem): _MESH_NOTE}
    near, far = divided(export)
    for kind in FORMATS:
        if not kind.package_note or (kind.is_page and not is_viewer_built()):
            continue
        file = data / f"{stem}{kind.suffixes[0]}"
        write_export(file, export if kind.is_page else near, kind.name, frame="upright", backend=backend)
        notes[file.name] = kind.package_note
    if far is not None:
        write_export(data / f"{stem}_far.ply", far, "ply", frame="upright", backend=backend)
        notes[f"{stem}_far.ply"] = "Gaussians of the scene that lie far outside of what the photos show"
    turn = turn_of(export, backend, should_stop)
    described["pictures"] = {"degrees": round(turn.degrees, 1), "photos_surround_it": turn.is_closed}
    pictures = _write_pictures(data, described["title"], turn)
    if with_photos:
        _copy_photos(data / "photos", project, described)
    if "object" not in described:
        notes |= _copy_reports(data, project)
    _write_records(data, stem, described, pictures, address)
    present = {path.relative_to(data).as_posix() for path in data.rglob("*") if path.is_file()}
    present |= {"ro-crate-metadata.json"}
    write_file(data / "README.txt", _readme(described, {name: notes[name] for name in notes if name in present}))
    write_crate(data, described, notes)


def _write_pictures(data: Path, title: str, turn: Turn) -> list[Picture]:
    folder = data / _PICTURES
    folder.mkdir()
    write_sheet(folder / SHEET, title, turn.pictures)
    write_films(folder, turn)
    shown = turn.pictures[::_IIIF_EVERY]
    pictures = []
    for number, pixels in enumerate(shown):
        name = f"{_PICTURES}/view_{number:02d}.jpg"
        Image.fromarray(pixels).save(data / name, quality=_QUALITY)
        height, width = pixels.shape[:2]
        pictures.append(Picture(name, f"View {number + 1} of {len(shown)}", width, height))
    return pictures


def _copy_photos(folder: Path, project: ProjectFolder, described: dict[str, Any]) -> None:
    for capture in described["captures"]:
        source = photo_file(project, capture)
        if source is None:
            raise ProjectError(
                f"The photo {capture['name']} is not in its folder any more, or has changed, so the package cannot "
                "contain it. Restore it, or leave out --with-photos."
            )
        target = path_within(folder, capture["name"])
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)


def _copy_reports(data: Path, project: ProjectFolder) -> dict[str, str]:
    """Copy the report in each language that the project has it in; return what each file is."""
    notes = {}
    for language in languages():
        report = report_file(project.path, language.code)
        if report.is_file():
            shutil.copyfile(report, data / report.name)
            notes[report.name] = f"the report of the reconstruction, for a browser ({language.name})"
    return notes


def _write_records(data: Path, stem: str, described: dict[str, Any], pictures: list[Picture], address: str) -> None:
    folder = data / _RECORDS
    folder.mkdir()
    files = [
        (path.relative_to(data).as_posix(), media_type(path))
        for path in (*sorted(data.glob(f"{stem}.*")), data / _mesh_name(stem), data / _PICTURES / SHEET)
        if path.is_file()
    ]
    write_json(folder / "paradata.json", finite_or_null(described))
    write_json(folder / "provenance.jsonld", finite_or_null(crm_json_ld(described)))
    write_file(folder / "dublin_core.xml", dublin_core_xml(described))
    links = _FROM_RECORDS if address.startswith(EXAMPLE_ADDRESS) else address
    write_file(folder / "lido.xml", lido_xml(described, files, address=links))
    manifest = iiif_manifest(described, pictures, address=address, name=_IIIF)
    (data / _IIIF).parent.mkdir()
    write_file(data / _IIIF, json.dumps(manifest, indent=1, ensure_ascii=False))


def _readme(described: dict[str, Any], notes: dict[str, str]) -> str:
    """Return what a person needs who has nothing but the package."""
    width = max(map(len, notes))
    files = "\n".join(f"  {name.ljust(width)}  {note}" for name, note in sorted(notes.items()))
    item = described.get("object") or {}
    facts: list[str | None] = [
        described["title"],
        *(item[name] for name in ("catalogue_number", "rights") if item.get(name)),
        "",
        "3D Gaussian splats, reconstructed from photographs by Gaussian Heritage "
        f"{described['exported']['software']['gaussian heritage']} on {described['exported']['finished']}.",
        described["unit"]["text"],
        (described.get("size") or {}).get("text"),
        _sides_text(described["pictures"], is_object=bool(item)),
    ]
    return (
        "\n".join(fact for fact in facts if fact is not None)
        + f"\n\nFiles\n\n{files}\n\n"
        + "The addresses in iiif/manifest.json say where the pictures are published; where they begin with\n"
        "https://example.org/ replace that by the address of this folder on your server.\n\n"
        "Is everything as it was? manifest-sha256.txt beside this folder lists the SHA-256 of each file. Run\n"
        "`sha256sum --check manifest-sha256.txt` there, or any BagIt program, such as\n"
        "`python -m engine verify PACKAGE` of Gaussian Heritage.\n"
    )


def _sides_text(pictures: dict[str, Any], *, is_object: bool) -> str | None:
    if not is_object:
        return None
    if pictures["photos_surround_it"]:
        return "The photographs surround it."
    return f"The pictures span {pictures['degrees']:.0f} degrees: no photograph shows the other sides."
