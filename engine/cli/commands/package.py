"""``package``: write objects or the scene with their records and pictures, each as one BagIt package."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from ...core.errors import ObjectError, SettingsError
from ...core.events import Emit, Finished, Progress, StopCheck, Warned
from ...project.folder import ProjectFolder
from .scene_options import add_device_option

NAME = "package"
HELP = "Write each object, or the whole scene, as a package to keep: files, records, pictures and checksums."
EXAMPLE = "python -m engine package scene --object vase --out packages"
LOG_IN = "project"
USES_CAMERAS = True
_ADDRESS = re.compile(r"https?://[^\s<>\"{}|\\^`]+/")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--object", action="append", default=[], help="name or id of an object; may be repeated (default: all objects)"
    )
    what.add_argument("--scene", action="store_true", help="one package of the whole scene")
    parser.add_argument("--title", help="title of the scene in the record (default: the name of the photo folder)")
    parser.add_argument("--out", type=Path, required=True, help="folder for the packages")
    parser.add_argument("--zip", action="store_true", help="write zip files instead of folders")
    parser.add_argument("--with-photos", action="store_true", help="put the photos into the packages too")
    parser.add_argument(
        "--with-mesh", action="store_true", help="put a textured mesh of each object into its package too; takes longer"
    )
    parser.add_argument(
        "--address",
        metavar="https://.../",
        help="where the package's folder `data` will be published, for IIIF and LIDO; several objects: the folder "
        "above, in which each has a folder of its own (default: an example that has to be replaced)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace packages that exist")
    add_device_option(parser, "render the pictures")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write the packages."""
    from ...delivery.packages import is_viewer_built, write_package
    from ...delivery.records import EXAMPLE_ADDRESS
    from ...project.objects import list_objects, load_object
    from ...rasterizer import Device, choose_device, device_words, run_on

    address = options.address or EXAMPLE_ADDRESS
    if not _ADDRESS.fullmatch(address):
        raise SettingsError(
            f"--address {address!r} is no address of a folder. Write for example https://example.org/a/."
        )
    if options.scene and options.with_mesh:
        raise SettingsError("A mesh is made of one object. Leave out --with-mesh, or --scene.")
    out: Path = options.out
    if out.exists() and not out.is_dir():
        raise SettingsError(f"{out} is a file. Choose a folder for the packages.")
    project = ProjectFolder.open_existing(options.project)
    names: list[str | None] = [None]
    if not options.scene:
        given = [load_object(project.path, one) for one in options.object]
        names = list(dict.fromkeys(record.id for record in given or list_objects(project.path)))
        if not names:
            raise ObjectError(f"{project.path} has no objects. Isolate one with `segment`, or add --scene.")
    if not is_viewer_built():
        emit(Warned("The packages get no page, because this installation lacks the viewer. Run `make page` first."))
    device = choose_device(options.device)
    written = []
    for number, name in enumerate(names):
        emit(Progress("package", number / len(names), message=f"{name or 'the scene'}"))

        def write(device: Device, name: str | None = name) -> Path:
            return write_package(
                out,
                project,
                name,
                title=options.title,
                address=address if len(names) == 1 else f"{address}{name}/",
                overwrite=options.overwrite,
                as_zip=options.zip,
                with_photos=options.with_photos,
                with_mesh=options.with_mesh,
                backend=device.backend,
                should_stop=should_stop,
            )

        made, device = run_on(device, write)
        written.append(made)
    words = f"Their pictures were rendered on {device_words(device.name, device.reason)}."
    count = f"{len(written)} package{'s' if len(written) != 1 else ''}"
    emit(Finished(f"Wrote {count} to {out}. {words}", {"packages": [str(path) for path in written]}))
    return 0
