"""A film of 20 seconds that shows the room of a project and three objects, as splats and as meshes; and a picture.

The camera goes through the places of the photos, then around each object on the sides that photos saw. All pictures are
rendered by the engine. Browsers play VP9 in WebM, and nobody asks a fee for it. The picture has photos, scene, objects.

example: python -m benchmarks.video --project out/museum_room/project --out docs/pictures
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from PIL import Image, ImageOps
from scipy.spatial.transform import Rotation, Slerp

from engine.cameras import training_pinhole
from engine.core.events import never_stop
from engine.core.files import atomic_write
from engine.delivery.packages import Export, load_export, mesh_of
from engine.delivery.report import PAPER_WHITE, best_seen_from, orbit_cameras, render_alone
from engine.meshing.settings import MeshSettings
from engine.pictures import Scene, render_view
from engine.project.folder import ProjectFolder
from engine.scene import Camera, Mesh, PinholeCamera

from .mesh_pictures import draw_mesh

WIDTH, HEIGHT = 720, 540
FRAMES_PER_SECOND = 24
ROOM_SECONDS, OBJECT_SECONDS = 8, 4
ROOM_PHOTOS = 16
"""The camera goes through as many photos, the first ones; more would hurry it."""
OBJECT_SIDE = 420
"""Side of an object's picture in pixels, of which the middle is shown: objects do not fill the width."""
QUALITY = 42
"""VP9's constant quality, 0 to 63: with 42, edges of splats show no blocks."""
OBJECTS = ("vase", "teapot", "mask")
FILM, PICTURE = "turntable.webm", "photos_scene_objects.jpg"
PANEL = (480, 360)
"""Width and height of a part of the picture."""


def main() -> int:
    """Render the pictures, write the film, and return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--project", type=Path, required=True, help="project folder of the demo")
    parser.add_argument("--objects", nargs="+", default=OBJECTS, help="names or ids (default: %(default)s)")
    parser.add_argument("--out", type=Path, required=True, help=f"folder for {FILM} and {PICTURE}")
    options = parser.parse_args()
    project = ProjectFolder.open_existing(options.project)
    scene = load_export(project, None)
    room = list(room_pictures(scene))
    around = []
    for name in options.objects:
        around.append(object_pictures(project, load_export(project, name)))
        print(f"{name}: {len(around[-1])} pictures", flush=True)
    frames = [*room, *(frame for turn in around for frame in turn)]
    write_film(options.out / FILM, frames)
    size = (options.out / FILM).stat().st_size / 1e6
    print(f"{options.out / FILM}: {len(frames) / FRAMES_PER_SECOND:.0f} s, {size:.2f} MB")
    photos = four_photos(Path(project.get("photo_folder")), scene.camera_set.cameras)
    picture = summary(photos, room[len(room) // 2], [turn[0] for turn in around])
    with atomic_write(options.out / PICTURE) as stream:
        Image.fromarray(picture).save(stream, "JPEG", quality=88)
    return 0


def four_photos(folder: Path, cameras: Sequence[Camera]) -> list[np.ndarray]:
    """Return four photos that are far apart in the order of names, upright."""
    names = sorted(camera.photo for camera in cameras)
    found = []
    for name in names[:: max(1, len(names) // 4)][:4]:
        with Image.open(folder / name) as photo:
            found.append(np.asarray(ImageOps.exif_transpose(photo).convert("RGB")))
    return found


def summary(photos: Sequence[np.ndarray], scene: np.ndarray, objects: Sequence[np.ndarray]) -> np.ndarray:
    """Return one picture of four photos, the scene, and three objects beside the mesh of the first."""
    top, half = (HEIGHT - WIDTH // 2) // 2, WIDTH // 2
    squares = [frame[top : top + half, :half] for frame in objects]
    squares.append(objects[0][top : top + half, half:])
    panels = [four(photos), cv2.resize(scene, PANEL, interpolation=cv2.INTER_AREA), four(squares)]
    rows = []
    for panel, word in zip(panels, ("photos", "scene", "objects, and a mesh"), strict=True):
        caption = np.full((40, PANEL[0], 3), 255, np.uint8)
        write_word(caption, word, (8, 28))
        rows.append(np.concatenate([caption, panel]))
    gap = np.full((rows[0].shape[0], 16, 3), 255, np.uint8)
    return np.concatenate([rows[0], gap, rows[1], gap, rows[2]], axis=1)


def four(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return four pictures in two rows, each as large as fits, on paper white."""
    width, height = PANEL[0] // 2, PANEL[1] // 2
    panel = np.full((PANEL[1], PANEL[0], 3), np.round(255 * np.array(PAPER_WHITE)), np.uint8)
    for number, picture in enumerate(pictures):
        scale = min(width / picture.shape[1], height / picture.shape[0])
        size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
        left = number % 2 * width + (width - size[0]) // 2
        top = number // 2 * height + (height - size[1]) // 2
        panel[top : top + size[1], left : left + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return panel


def room_pictures(export: Export) -> Iterator[np.ndarray]:
    """Yield pictures of the scene, uint8 [HEIGHT, WIDTH, 3], on the way through the photos' places."""
    for camera in way_through(export.camera_set.cameras, ROOM_SECONDS * FRAMES_PER_SECOND):
        yield render_view(export.gaussians, camera)


def way_through(cameras: Sequence[Camera], count: int) -> list[PinholeCamera]:
    """Return cameras of the film's size at even distances on the way from photo to photo, in the order of names."""
    ordered = sorted(cameras, key=lambda camera: camera.photo)[:ROOM_PHOTOS]
    centers = np.array([camera.center for camera in ordered])
    # The way also counts how far the camera turns, so that a turn on the spot takes its time.
    turns = Rotation.from_matrix([camera.viewmat[:3, :3] for camera in ordered])
    angles = (turns[1:] * turns[:-1].inv()).magnitude()
    lengths = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    at = np.concatenate([[0], np.cumsum(lengths + lengths.mean() * angles / max(angles.mean(), 1e-9))])
    places = np.linspace(0, at[-1], count)
    rotations = Slerp(at, turns)(places).as_matrix()
    first = training_pinhole(ordered[0], max_side=WIDTH)
    scale = HEIGHT / first.height
    K = first.K * np.array([[scale], [scale], [1.0]])
    K[:2, 2] = WIDTH / 2, HEIGHT / 2
    found = []
    for rotation, place in zip(rotations, places, strict=True):
        center = np.array([np.interp(place, at, centers[:, axis]) for axis in range(3)])
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ center
        found.append(PinholeCamera(viewmat, K, WIDTH, HEIGHT))
    return found


def object_pictures(project: ProjectFolder, export: Export) -> list[np.ndarray]:
    """Return pictures around an object, its splats on the left and its mesh on the right."""
    assert export.members is not None
    mesh = mesh_of(project, export, MeshSettings(), should_stop=never_stop).mesh
    (seen_from,) = best_seen_from(Scene(export.whole), [export.members], export.camera_set.cameras)
    half = OBJECT_SECONDS * FRAMES_PER_SECOND // 2
    sides = orbit_cameras(export.gaussians.means, seen_from, count=half + 1, side=OBJECT_SIDE)
    there = [side_by_side(export, mesh, side) for side in sides]
    return [*there[:-1], *there[:0:-1]]


def side_by_side(export: Export, mesh: Mesh, camera: PinholeCamera) -> np.ndarray:
    """Return one picture of the film: splats, mesh, and what they are."""
    paper = np.array(PAPER_WHITE)
    splats = render_alone(Scene(replace(export.gaussians, features=None)), camera)
    drawn = np.round(255 * draw_mesh(mesh, camera, background=paper)).astype(np.uint8)
    picture = np.full((HEIGHT, WIDTH, 3), np.round(255 * paper), np.uint8)
    top, half = (HEIGHT - OBJECT_SIDE) // 2, WIDTH // 2
    left = (OBJECT_SIDE - half) // 2
    for number, square in enumerate((splats, drawn)):
        picture[top : top + OBJECT_SIDE, number * half : (number + 1) * half] = square[:, left : left + half]
    write_word(picture, "Gaussian splats", (24, HEIGHT - 40))
    write_word(picture, "mesh", (WIDTH // 2 + 24, HEIGHT - 40))
    return picture


def write_word(picture: np.ndarray, word: str, left_bottom: tuple[int, int]) -> None:
    """Write a word into a picture, in dark grey."""
    cv2.putText(picture, word, left_bottom, cv2.FONT_HERSHEY_SIMPLEX, 0.8, (60, 60, 60), 1, cv2.LINE_AA)


def write_film(path: Path, frames: Sequence[np.ndarray]) -> None:
    """Write pictures as a film in WebM."""
    with atomic_write(path) as stream, av.open(stream, "w", format="webm") as film:
        track = film.add_stream("libvpx-vp9", rate=Fraction(FRAMES_PER_SECOND))
        track.width, track.height, track.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        track.bit_rate = 0
        track.options = {"crf": str(QUALITY), "deadline": "good", "cpu-used": "2", "g": "240"}
        for frame in frames:
            film.mux(track.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")))
        film.mux(track.encode())


if __name__ == "__main__":
    sys.exit(main())
