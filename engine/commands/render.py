"""``render``: render the scene from the camera of a photo or a given camera."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CameraError, SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder
from ..scene import Camera, CameraSet, PinholeCamera

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["EXAMPLE", "HELP", "NAME", "USES_CAMERAS", "add_arguments", "project_folder", "run"]

NAME = "render"
HELP = "Render the scene or an object, in the pixels of the original photo after EXIF rotation."
EXAMPLE = "python -m engine render scene --view IMG_3023.jpg --what rgb --out view.png"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    camera = parser.add_mutually_exclusive_group(required=True)
    camera.add_argument("--view", metavar="PHOTO_NAME", help="a registered photo")
    camera.add_argument("--camera", metavar="FILE.json", type=Path, help="width, height, fx, fy, cx, cy, viewmat (4x4)")
    parser.add_argument(
        "--object", help="render this object only, by name or id (with --what mask: where it is visible)"
    )
    parser.add_argument("--what", choices=("rgb", "mask", "depth", "features", "instances"), default="rgb")
    parser.add_argument("--click", metavar="x,y", help="with features or instances: the cosine-0.7 mask at that pixel")
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "gpu"),
        default="auto",
        help="auto: the graphics card if there is one that passes its self-test (see `doctor`)",
    )
    parser.add_argument("--out", type=Path, required=True, help="PNG to write")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")


def project_folder(options: argparse.Namespace) -> Path:
    """Return the project whose log is written."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Render and write the picture."""
    from ..cameras import read_camera_json
    from ..gaussians import load_gaussians
    from ..objects import load_membership, load_object, object_gaussians
    from ..pictures import render_view, write_png
    from ..rasterizer import Device, choose_device, run_on
    from ..scene import read_camera_set

    out: Path = options.out
    if out.is_dir():
        raise SettingsError(f"{out} is a folder. Choose a file name.")
    if out.suffix.lower() != ".png":
        raise SettingsError(f"Pictures are written as PNG, but {out} has another extension.")
    if out.exists() and not options.overwrite:
        raise SettingsError(f"{out} already exists. Choose another name or add --overwrite.")
    project = ProjectFolder.open_existing(options.project)
    project.require_intact("cameras", "training")
    camera: Camera | PinholeCamera
    if options.view is not None:
        camera = _camera_of(read_camera_set(project.path / "cameras"), options.view)
    else:
        camera = read_camera_json(options.camera)
    gaussians, members = load_gaussians(project.path / "gaussians"), None
    if options.object is not None:
        record = load_object(project.path, options.object)
        if options.what == "rgb":
            gaussians = object_gaussians(project.path, record, gaussians)
        else:
            members = load_membership(project.path, record.id) >= record.threshold
    click = None if options.click is None else _pixel(options.click)

    def render(device: Device) -> NDArray[Any]:
        return render_view(gaussians, camera, what=options.what, members=members, click=click, backend=device.backend)

    picture, device = run_on(choose_device(options.device), render)
    write_png(out, picture)
    why = f", because {device.reason}" if device.reason else ""
    emit(Finished(f"Wrote {out}. It was rendered on {device.name}{why}.", {"file": str(out), "device": device.name}))
    return 0


def _camera_of(camera_set: CameraSet, photo: str) -> Camera:
    for camera in camera_set.cameras:
        if camera.photo == photo:
            return camera
    names = ", ".join(camera.photo for camera in camera_set.cameras[:5])
    raise CameraError(f"No registered photo is called {photo!r}. The first ones are: {names}.")


def _pixel(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as error:
        raise SettingsError(f"--click must be x,y in pixels, got {text!r}.") from error
    return x, y
