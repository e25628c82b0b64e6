"""A finished project whose photos have EXIF, with an object that a curator has described."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.files import file_sha256
from engine.project.folder import ProjectFolder
from engine.project.objects import MuseumRecord, ObjectRecord, save_object, save_record
from engine.project.provenance import describe_run
from engine.scene import Photo, PhotoSet, RejectedPhoto, write_photo_set
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, HEIGHT, WIDTH, BlobScene

TITLE = "Ölkanne mit Deckel, ein sehr langer Titel <b>&amp;</b>"


def write_exif_photos(folder: Path) -> None:
    """Give each photo the EXIF of a phone, with a place and a serial number that no record may repeat."""
    for number, path in enumerate(sorted(folder.glob("*.png"))):
        with Image.open(path) as image:
            exif = image.getexif()
            exif[0x010F], exif[0x0110] = "Acme", "Phone 3"
            camera = exif.get_ifd(0x8769)
            camera[0x9003] = f"2026:05:0{1 + number % 3} 10:20:30"
            camera[0x829A], camera[0x8827], camera[0xA431] = 0.005, 200, "SERIAL-4711"
            exif.get_ifd(0x8825)[1] = "N"
            image.save(path, exif=exif)


def make_project(blobs: BlobScene, folder: Path) -> ProjectFolder:
    """Write the project."""
    project = trained_project(blobs, folder)
    write_exif_photos(folder / "photos")
    photos = [
        Photo(path.name, WIDTH, HEIGHT, None, file_sha256(path)) for path in sorted((folder / "photos").glob("*.png"))
    ]
    photo_set = PhotoSet(folder / "photos", tuple(photos), (RejectedPhoto("dark.jpg", "It is dark."),))
    write_photo_set(project.path / "photos" / "photos.json", photo_set)
    with ProjectFolder.open_existing(project.path) as held:
        held.put("photo_folder", str(folder / "photos"))
        held.finish_stage(
            "photos", "k", wall_seconds=1, cpu_seconds=1,
            figures={"n_photos": len(photo_set.photos), "rejected": [{"name": "dark.jpg", "reason": "It is dark."}]},
            run=describe_run({"min_side": 100}),
        )  # fmt: skip
        held.finish_stage(
            "training", "k", wall_seconds=5, cpu_seconds=9,
            figures={"psnr": 27.25, "held_out": ["view_3.png"], "n_gaussians": len(blobs.gaussians)},
            outputs=[project.path / "gaussians" / "scene.ply"], run=describe_run({"seed": 5, "steps": 100}),
        )  # fmt: skip
    record = ObjectRecord(
        "kanne", "Kanne", {"kind": "text", "text": "jug"}, 0.5, 0.75, 0.5, int((blobs.part == BLUE).sum()),
        len(blobs.part), evidence=({"photo": "view_0.png", "score": 0.75},), settings={"cosine": 0.7}, seconds=2.5,
        created="2026-01-01T00:00:00.000000+00:00",
        refined=({"clicks": [{"photo": "view_0.png", "x": 1.0, "y": 2.0}], "not": []},), run=describe_run(),
    )  # fmt: skip
    save_object(project.path, record, (blobs.part == BLUE).astype(np.float32))
    save_record(
        project.path, "kanne", MuseumRecord("1906.12", TITLE, "CC BY 4.0, Musée", "first line\nsecond\x07 line")
    )
    return ProjectFolder.open_existing(project.path)


@pytest.fixture(scope="package")
def project(blobs: BlobScene, tmp_path_factory: pytest.TempPathFactory) -> ProjectFolder:
    """The project, which no test changes."""
    return make_project(blobs, tmp_path_factory.mktemp("scene"))
