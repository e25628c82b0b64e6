"""``render``: render the scene from the camera of a photo or a given camera."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import CameraError, Cancelled, SettingsError
from ...core.events import Emit, Finished, Progress, StopCheck
from ...project.folder import ProjectFolder
from ...project.objects import load_membership, load_object, object_gaussians
from ...scene import Camera, CameraSet, PinholeCamera, read_camera_set
from .named_photos import known_photo
from .scene_options import add_device_option

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ...pictures import Subject
    from ...project.objects import ObjectRecord
    from ...rasterizer import Device
    from ...scene import Gaussians

NAME = "render"
HELP = "Render the scene or an object, in the pixels of the original photo after EXIF rotation."
EXAMPLE = "python -m engine render scene --view IMG_3023.jpg --what rgb --out view.png"
LOG_IN = "project"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--view", metavar="PHOTO_NAME", action="append", default=[], help="a registered photo")
    parser.add_argument(
        "--camera", metavar="FILE.json", type=Path, action="append", default=[],
        help="width, height, fx, fy, cx, cy, viewmat (4x4); --view and --camera may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--object", action="append", default=[],
        help="render this object only, by name or id (with --what mask: where it is visible); may be repeated",
    )  # fmt: skip
    parser.add_argument("--what", choices=("rgb", "mask", "depth", "features", "instances"), default="rgb")
    parser.add_argument(
        "--click", metavar="x,y",
        help="with mask: the object at that pixel; with features or instances: pixels like it",
    )  # fmt: skip
    add_device_option(parser, "render the pictures")
    parser.add_argument("--out", type=Path, required=True, help="PNG to write; a folder for several pictures")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Render and write the pictures."""
    from ...pictures import write_png
    from ...rasterizer import choose_device, run_on
    from ...training import load_gaussians

    if not options.view and not options.camera:
        raise SettingsError("Give at least one --view or --camera.")
    project = ProjectFolder.open_existing(options.project)
    project.require_intact("cameras", "training")
    cameras = _cameras(project, options)
    objects = [load_object(project.path, name) for name in options.object]
    files = _files(options, list(cameras), objects)
    click = None if options.click is None else _pixel(options.click)
    if click is not None and (len(files) > 1 or (objects and options.what == "mask")):
        raise SettingsError("--click goes with one view, and with --what mask without an object.")
    gaussians = load_gaussians(project.path / "gaussians")
    device = choose_device(options.device)
    written: list[str] = []
    for label, camera in cameras.items():
        if should_stop():
            raise Cancelled(f"Stopped after {len(written)} of {len(files)} pictures.")

        def render(device: Device, camera: Camera | PinholeCamera = camera) -> list[NDArray[Any]]:
            return _pictures(project, gaussians, camera, objects, options.what, click, device, should_stop)

        pictures, device = run_on(device, render)
        for key, picture in zip([record.id for record in objects] or [""], pictures, strict=True):
            file = files[label, key]
            file.parent.mkdir(parents=True, exist_ok=True)
            write_png(file, picture)
            written.append(str(file))
        emit(Progress("render", len(written) / len(files), message=f"Rendering {label}"))
    why = f", because {device.reason}" if device.reason else ""
    what = f"{options.out}. It was" if len(written) == 1 else f"{len(written)} pictures into {options.out}. They were"
    outputs = {"file": written[0], "files": written, "device": device.name}
    emit(Finished(f"Wrote {what} rendered on {device.name}{why}.", outputs))
    return 0


def _pictures(
    project: ProjectFolder,
    gaussians: Gaussians,
    camera: Camera | PinholeCamera,
    objects: Sequence[ObjectRecord],
    what: Subject,
    click: tuple[float, float] | None,
    device: Device,
    should_stop: StopCheck,
) -> list[NDArray[Any]]:
    """Return the picture of each object from one camera; without objects, one picture of the scene."""
    from ...pictures import Scene, render_view, visible_masks

    if what == "mask" and click is not None:
        from ...masks import load_default_sam
        from ...objects import load_context, mask_at
        from ...objects.grounding import load_default_detector
        from ...objects.settings import BETTER

        models = (load_default_detector, load_default_sam)
        context = load_context(project, BETTER, *models, device=device, should_stop=should_stop)
        return [np.where(mask_at(context, camera, click), np.uint8(255), np.uint8(0))]
    if what == "rgb" and objects:
        alone = (object_gaussians(project.path, record, gaussians) for record in objects)
        return [render_view(shown, camera, backend=device.backend) for shown in alone]
    members = [load_membership(project.path, record.id) >= record.threshold for record in objects]
    if what == "mask" and objects:
        masks = visible_masks(Scene(gaussians, backend=device.backend), camera, members)
        return [np.where(mask, np.uint8(255), np.uint8(0)) for mask in masks]
    wanted: Sequence[NDArray[np.bool_] | None] = members or (None,)
    return [
        render_view(gaussians, camera, what=what, members=each, click=click, backend=device.backend) for each in wanted
    ]


def _cameras(project: ProjectFolder, options: argparse.Namespace) -> dict[str, Camera | PinholeCamera]:
    """Return the cameras of all views by the name that their files get."""
    from ...cameras import read_camera_json

    known = read_camera_set(project.path / "cameras")
    pairs: list[tuple[str, Camera | PinholeCamera]] = [(photo, _camera_of(known, photo)) for photo in options.view]
    pairs += [(file.name, read_camera_json(file)) for file in options.camera]
    cameras = {"-".join(PurePosixPath(name).with_suffix("").parts): camera for name, camera in pairs}
    if len(cameras) < len(pairs):
        raise SettingsError("Two of the views would have the same file name. Render them one by one.")
    return cameras


def _files(
    options: argparse.Namespace, labels: Sequence[str], objects: Sequence[ObjectRecord]
) -> dict[tuple[str, str], Path]:
    """Return the file of each picture by the name of its view and the id of its object, empty for the scene."""
    out: Path = options.out
    pairs = [(label, key) for label in labels for key in ([record.id for record in objects] or [""])]
    if len(pairs) > 1:
        if out.suffix.lower() == ".png" or out.is_file():
            raise SettingsError(f"{out} is a file, but {len(pairs)} pictures are wanted. Choose a folder.")
        files = {pair: out / ("-".join(part for part in pair if part) + ".png") for pair in pairs}
    else:
        if out.is_dir():
            raise SettingsError(f"{out} is a folder. Choose a file name.")
        if out.suffix.lower() != ".png":
            raise SettingsError(f"Pictures are written as PNG, but {out} has another extension.")
        files = {pairs[0]: out}
    for file in files.values():
        if file.exists() and not options.overwrite:
            raise SettingsError(f"{file} already exists. Choose another name or add --overwrite.")
    return files


def _camera_of(camera_set: CameraSet, photo: str) -> Camera:
    known = camera_set.by_photo
    camera = known.get(known_photo(photo, known))
    if camera is None:
        raise CameraError(f"No registered photo is called {photo!r}. The first ones are: {', '.join(list(known)[:5])}.")
    return camera


def _pixel(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as error:
        raise SettingsError(f"--click must be x,y in pixels, got {text!r}.") from error
    return x, y
