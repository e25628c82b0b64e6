# SPDX-License-Identifier: GPL-3.0-or-later
"""Command line, ground truth and rendering of the photos of a scene."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

# Blender reads this when bpy is imported, so that the user's settings are neither used nor changed.
_SETTINGS = tempfile.TemporaryDirectory(prefix="heritage-demo-")
os.environ["BLENDER_USER_RESOURCES"] = _SETTINGS.name

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from mathutils import Matrix  # noqa: E402

from . import materials  # noqa: E402
from .phone import Phone, save_ids  # noqa: E402
from .stage import SEEN_THROUGH, Scene  # noqa: E402
from .views import View, plan, useful_order  # noqa: E402


def main(folder: Path, description: str) -> None:
    """Parse the command line and create the missing photos and masks of the scene in `room.py` of a folder."""
    # `room` imports bpy, which must have its settings before.
    scene: Scene = import_module("room").SCENE
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--out", type=Path, default=folder, help="folder for photos/ and truth/ (default: the folder of this script)"
    )
    parser.add_argument("--views", type=int, default=scene.photos, help="number of photos (default: %(default)s)")
    parser.add_argument(
        "--samples", type=int, default=scene.samples, help="Cycles samples per pixel, denoised (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="random seed of camera path, exposures and noise (default: 0)"
    )
    parser.add_argument("--scale", type=int, default=1, help="times the size of the photos (default: 1)")
    parser.add_argument("--only", type=int, nargs="+", help="render these photos only, by number")
    parser.add_argument("--masks-only", action="store_true", help="write the ground truth and stop")
    arguments = parser.parse_args()

    if arguments.scale < 1:
        parser.error(f"--scale must be at least 1, got {arguments.scale}")

    phone = scene.phone.scaled(arguments.scale)
    photos, masks = prepare_folders(arguments.out)
    views = plan(scene.walks, scene.centre, arguments.views, arguments.seed)
    names = {
        str(i): {"name": place.name, "prompt": place.prompt or place.name}
        for i, place in enumerate(scene.places, start=1)
    }
    try:
        write_truth(views, names, phone, arguments.out / "truth")
    except FileExistsError as error:
        parser.error(str(error))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene.build()
    camera(phone)
    order = arguments.only or useful_order(len(views))

    with mask_rendering():
        for index in order:
            path = masks / f"{views[index].name}.png"
            if not path.exists():
                save_ids(render_ids(views[index], phone), path)
    if arguments.masks_only:
        return

    setup_photos(arguments.samples, scene.bounces)
    for done, index in enumerate(order, start=1):
        path = photos / f"{views[index].name}.jpg"
        if not path.exists():
            started = time.perf_counter()
            pixels = render_photo(views[index], phone, arguments.seed + index, (arguments.seed, index))
            phone.save_photo(pixels, path, f"{scene.title}, synthetic, CC0")
            print(f"{path.name} {done}/{len(order)} {time.perf_counter() - started:.0f} s", flush=True)


def prepare_folders(out: Path) -> tuple[Path, Path]:
    """Create and return the folders of photos and masks, without the unfinished files of a killed run."""
    photos, masks = out / "photos", out / "truth" / "masks"
    for place in (photos, masks):
        place.mkdir(parents=True, exist_ok=True)
        for unfinished in place.glob("*.part"):
            unfinished.unlink()
    return photos, masks


def write_truth(views: Sequence[View], names: Mapping[str, object], phone: Phone, folder: Path) -> None:
    """Write ``cameras.json`` and ``names.json``.

    Raises
    ------
    FileExistsError
        When the folder has other cameras, with which its photos and masks belong.
    """
    cx, cy = phone.centre
    cameras = {
        "convention": (
            "world_to_camera is a 4x4 row-major matrix into camera axes x right, y down, z forward (OpenCV). "
            "The world is Blender's: Z up, metres. "
            "Intrinsics are pixels with the centre of the upper left pixel at (0.5, 0.5), as in COLMAP. "
            "SIMPLE_RADIAL: distorted = ideal * (1 + k1 * r^2), "
            "r in ideal normalised coordinates."
        ),
        "photos": [
            {
                "file": f"{view.name}.jpg",
                "model": "SIMPLE_RADIAL",
                "width": phone.width,
                "height": phone.height,
                "params": {"f": phone.focal, "cx": cx, "cy": cy, "k1": phone.k1},
                "exposure_stops": round(view.exposure, 4),
                "world_to_camera": np.round(view.world_to_camera, 9).tolist(),
            }
            for view in views
        ],
    }
    known = folder / "cameras.json"
    if known.exists() and json.loads(known.read_text(encoding="utf-8"))["photos"] != cameras["photos"]:
        raise FileExistsError(f"{folder.parent} holds photos of other views or another seed; choose another --out")
    write_json(known, cameras)
    write_json(folder / "names.json", names)


def write_json(path: Path, content: object) -> None:
    """Write a JSON file atomically."""
    write_text(path, json.dumps(content, indent=1) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    unfinished = path.with_name(f"{path.name}.part")
    unfinished.write_text(text, encoding="utf-8")
    os.replace(unfinished, path)


def camera(phone: Phone) -> None:
    """Add the camera, with the photo's focal length and a slightly larger sensor (see `phone`)."""
    data = bpy.data.cameras.new("Phone")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    wide, tall = phone.ideal_size
    data.lens = 36.0 * phone.focal / wide
    data.clip_start = 0.05
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Phone", data)
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = wide, tall
    scene.render.resolution_percentage = 100


def aim_camera(view: View) -> None:
    """Set the pose of the camera; Blender's cameras look along -Z with +Y up."""
    to_blender = np.diag([1.0, -1.0, -1.0, 1.0])
    bpy.context.scene.camera.matrix_world = Matrix((np.linalg.inv(view.world_to_camera) @ to_blender).tolist())


@contextmanager
def mask_rendering(shown: bpy.types.Material | None = None) -> Iterator[None]:
    """Configure rendering of the object index with one unfiltered sample per pixel; restore the sky and panes after.

    What the material `shown` emits is rendered instead, if it is given.
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.view_layers[0].material_override = shown or materials.instance_id()
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    sky = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    brightness = sky.default_value
    panes = [thing for thing in scene.objects if thing.get(SEEN_THROUGH)]
    sky.default_value = 0
    for pane in panes:
        pane.hide_render = True
    try:
        yield
    finally:
        sky.default_value = brightness
        for pane in panes:
            pane.hide_render = False
        scene.view_layers[0].material_override = None


def render_ids(view: View, phone: Phone) -> np.ndarray:
    """Return the instance ids of a photo (h, w) uint8, within `mask_rendering`."""
    aim_camera(view)
    return phone.remap_ids(np.rint(render()[..., 0] * 255).astype(np.uint8))


def render_photo(view: View, phone: Phone, cycles_seed: int, noise_seed: Sequence[int]) -> np.ndarray:
    """Return the sRGB pixels of a photo (h, w, 3) uint8, after `setup_photos`."""
    aim_camera(view)
    bpy.context.scene.cycles.seed = cycles_seed
    return phone.expose(render(), view.exposure, np.random.default_rng(noise_seed))


def setup_photos(samples: int, bounces: int) -> None:
    """Configure path tracing for a few CPU cores."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.adaptive_threshold = samples, True, 0.03
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_quality = "BALANCED"
    # After the first bounce, the light of the sky approximates the even light of the room.
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 2, 2, bounces
    cycles.use_fast_gi, cycles.fast_gi_method, cycles.ao_bounces_render = True, "REPLACE", 1
    cycles.use_light_tree = False
    cycles.transparent_max_bounces = 8
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 4.0
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    scene.render.use_persistent_data = True


def render() -> np.ndarray:
    """Return the rendered scene as a linear float picture (h, w, 3), first row at the top."""
    scene = bpy.context.scene
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"
    scene.render.filepath = str(Path(_SETTINGS.name) / "render.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(picture.size[0] * picture.size[1] * picture.channels, np.float32)
    picture.pixels.foreach_get(pixels)
    shape = (picture.size[1], picture.size[0], picture.channels)
    bpy.data.images.remove(picture)
    return np.ascontiguousarray(pixels.reshape(shape)[::-1, :, :3])
