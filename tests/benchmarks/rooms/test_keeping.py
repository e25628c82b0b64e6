"""A kept room comes back as a project that prompts can use, and a hostile archive writes nothing."""

from __future__ import annotations

import io
import lzma
import os
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.rooms.draws import CHOOSING_ROOMS, Room
from benchmarks.rooms.keeping import KEPT_FOLDER, pack_room, rounded, rounded_gaussians, unpack_room
from engine.core.errors import FormatError, HeritageError, ProjectError
from engine.masks import label_map_path, read_label_map
from engine.masks.storage import write_label_map
from engine.objects import MaskPrompt, find_objects, load_context
from engine.objects.settings import BETTER
from engine.pictures import write_png
from engine.project.folder import ProjectFolder
from engine.scene import PhotoSet, read_photo_set, write_photo_set
from engine.training import load_gaussians
from tests.conftest import ROOT
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import RED, BlobScene, make_scene
from tests.engine.quality.evaluation.test_isolation import write_truth

ROOM, COMMIT = CHOOSING_ROOMS[2], "0123456789abcdef" * 2 + "01234567"
ARCHIVE = f"{ROOM.name}.tar.xz"
MAX_BYTES = 20e6
"""Of all kept rooms together, so that a clone stays small."""


@pytest.fixture(scope="module")
def blobs() -> BlobScene:
    return make_scene()


def trained_room(scene: BlobScene, root: Path) -> ProjectFolder:
    """Write the choosing room below ``out/rooms``, trained, with things that are not kept."""
    folder = root / "out" / "rooms" / ROOM.name
    made = trained_project(scene, folder)
    write_truth(scene, folder / "truth")
    target = folder / COMMIT[:12] / "project"
    target.parent.mkdir()
    made.path.rename(target)
    project = ProjectFolder.open_existing(target)
    for photo, labels in scene.labels.items():
        write_label_map(label_map_path(target / "masks", photo), labels.astype(np.int32))
    for name in ("log.jsonl", "masks/view_0.png.sam.npz", "checkpoints/run/1.npz", "report/report.html"):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_text("can be made again", encoding="utf-8")
    listing = target / "photos" / "photos.json"
    listing.parent.mkdir(exist_ok=True)
    write_photo_set(listing, PhotoSet(folder=folder / "photos", photos=(), rejected=()))
    files = {
        "photos": [listing],
        "cameras": [target / "cameras" / "cameras.json", target / "cameras" / "points.npz"],
        "masks": [label_map_path(target / "masks", photo) for photo in scene.labels],
        "training": [target / "gaussians" / "scene.ply", target / "gaussians" / "features.npy"],
    }
    for stage, outputs in files.items():
        project.finish_stage(stage, "key", wall_seconds=1, cpu_seconds=1, figures={}, outputs=outputs)
    return project


@pytest.fixture(scope="module")
def kept(blobs: BlobScene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ProjectFolder]:
    """A packed room: the repository, and the project that was packed."""
    root = tmp_path_factory.mktemp("repository")
    project = trained_room(blobs, root)
    assert pack_room(root, ROOM, COMMIT) == (root / KEPT_FOLDER / ARCHIVE).stat().st_size
    return root, project


def test_a_kept_room_answers_prompts_as_before(
    kept: tuple[Path, ProjectFolder], blobs: BlobScene, tmp_path: Path
) -> None:
    root, before = kept
    opened = ProjectFolder.open_existing(unpack_room(root / KEPT_FOLDER / ARCHIVE, tmp_path / "room"))
    photo = next(iter(blobs.labels))
    mask = tmp_path / "mask.png"
    write_png(mask, np.where(blobs.labels[photo] == RED, np.uint8(255), np.uint8(0)))
    members = []
    for project in (before, opened):
        context = load_context(project, BETTER, lambda: FakeDetector(blobs), lambda: FakeSam(blobs))
        members.append(find_objects(context, MaskPrompt(photo, mask))[0].members)
    # Rounding may move a Gaussian at the rim across the threshold.
    assert (members[0] & members[1]).sum() >= 0.99 * (members[0] | members[1]).sum() > 0


def test_unpacking_restores_photos_truth_and_label_maps(
    kept: tuple[Path, ProjectFolder], blobs: BlobScene, tmp_path: Path
) -> None:
    root, before = kept
    project = ProjectFolder.open_existing(unpack_room(root / KEPT_FOLDER / ARCHIVE, tmp_path / "room"))
    source = root / "out" / "rooms" / ROOM.name
    assert project.get("photo_folder") == str((tmp_path / "room" / "photos").resolve())
    for part in ("photos", "truth"):
        files = [path for path in (source / part).rglob("*") if path.is_file()]
        assert files
        for path in files:
            assert (tmp_path / "room" / path.relative_to(source)).read_bytes() == path.read_bytes()
    for photo, labels in blobs.labels.items():
        assert np.array_equal(read_label_map(label_map_path(project.path / "masks", photo)), labels)
    project.require_intact("photos", "cameras", "masks", "training")
    assert project.recorded_outputs("training").keys() == before.recorded_outputs("training").keys()


def test_what_can_be_made_again_and_the_machine_are_not_kept(kept: tuple[Path, ProjectFolder]) -> None:
    root, _ = kept
    content = lzma.decompress((root / KEPT_FOLDER / ARCHIVE).read_bytes())
    with tarfile.open(fileobj=io.BytesIO(content)) as tar:
        names = tar.getnames()
    assert "project/project.json" in names and "truth/names.json" in names
    assert not any(word in name for name in names for word in ("sam.npz", "checkpoints", "report", "log", "lock"))
    assert str(root).encode() not in content


def test_the_same_room_makes_the_same_archive(kept: tuple[Path, ProjectFolder]) -> None:
    root, _ = kept
    before = (root / KEPT_FOLDER / ARCHIVE).read_bytes()
    pack_room(root, ROOM, COMMIT)
    assert (root / KEPT_FOLDER / ARCHIVE).read_bytes() == before


def test_gaussians_of_a_kept_room_are_the_rounded_ones(kept: tuple[Path, ProjectFolder], tmp_path: Path) -> None:
    root, before = kept
    project = unpack_room(root / KEPT_FOLDER / ARCHIVE, tmp_path / "room")
    stored, expected = (
        load_gaussians(project / "gaussians"),
        rounded_gaussians(load_gaussians(before.path / "gaussians")),
    )
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh", "features"):
        assert np.array_equal(getattr(stored, name), getattr(expected, name)), name


@pytest.mark.parametrize("places", [4, 7, 11])
def test_rounding_keeps_the_nearest_number_with_few_binary_places(places: int) -> None:
    values = np.random.default_rng(0).normal(size=10_000).astype(np.float32)
    result = rounded(values, places)
    assert result.dtype == np.float32 and np.abs(result - values).max() <= 2.0 ** -(places + 1)
    assert np.array_equal(result * 2.0**places, np.round(result * 2.0**places))


def test_an_existing_folder_is_not_overwritten(kept: tuple[Path, ProjectFolder], tmp_path: Path) -> None:
    root, _ = kept
    (tmp_path / "room").mkdir()
    with pytest.raises(ProjectError, match="exists already. Choose a new folder"):
        unpack_room(root / KEPT_FOLDER / ARCHIVE, tmp_path / "room")
    assert list((tmp_path / "room").iterdir()) == []


def test_a_room_that_is_not_trained_is_not_kept(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_room(blobs, tmp_path)
    project.forget_stages(["training"])
    with pytest.raises(ProjectError, match="is not trained. Run `make test-rooms` first"):
        pack_room(tmp_path, ROOM, COMMIT)


Change = Callable[[tarfile.TarInfo], None]


def hostile(name: str, change: Change = lambda entry: None) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:") as tar:
        for member in ("photos/a.jpg", name):
            entry = tarfile.TarInfo(member)
            entry.size = 4
            if member == name:
                change(entry)
            tar.addfile(entry, io.BytesIO(b"evil"))
    return buffer.getvalue()


def as_type(kind: bytes, target: str = "../../evil.txt") -> Change:
    def change(entry: tarfile.TarInfo) -> None:
        entry.type, entry.linkname, entry.size = kind, target, 0

    return change


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (hostile("../evil.txt"), "leads out of the folder"),
        (hostile("photos/../../evil.txt"), "leads out of the folder"),
        (hostile("/evil.txt"), "leads out of the folder"),
        (hostile("evil.txt"), "leads out of the folder"),
        (hostile("photos/link", as_type(tarfile.SYMTYPE)), "is no regular file"),
        (hostile("photos/link", as_type(tarfile.LNKTYPE)), "is no regular file"),
        (hostile("photos/pipe", as_type(tarfile.FIFOTYPE)), "is no regular file"),
        (hostile("photos/a.jpg"), "is there twice"),
        (hostile("photos/a.jpg/b.jpg"), "is there twice"),
        (hostile("photos/b.jpg")[:700], "cannot be unpacked"),
        (b"no tar" * 1000, "cannot be unpacked"),
        (bytes(80 << 20), "too large"),
    ],
)
def test_a_hostile_archive_is_refused_and_writes_nothing(tmp_path: Path, content: bytes, problem: str) -> None:
    archive = tmp_path / "in" / "room_1.tar.xz"
    archive.parent.mkdir()
    archive.write_bytes(lzma.compress(content, preset=0))
    (tmp_path / "out").mkdir()
    with pytest.raises(FormatError, match=problem) as caught:
        unpack_room(archive, tmp_path / "out" / "room")
    assert str(archive) in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["in", "out"] and os.listdir(tmp_path / "out") == []


@pytest.mark.parametrize("n_bytes", [0, 100, 2000])
def test_a_damaged_archive_is_refused_in_a_sentence(
    kept: tuple[Path, ProjectFolder], tmp_path: Path, n_bytes: int
) -> None:
    root, _ = kept
    archive = tmp_path / ARCHIVE
    archive.write_bytes((root / KEPT_FOLDER / ARCHIVE).read_bytes()[:n_bytes])
    with pytest.raises(FormatError, match="cannot be unpacked"):
        unpack_room(archive, tmp_path / "room")
    assert not (tmp_path / "room").exists()


def test_an_archive_without_a_project_is_refused(tmp_path: Path) -> None:
    archive = tmp_path / ARCHIVE
    archive.write_bytes(lzma.compress(hostile("truth/names.json")))
    with pytest.raises(HeritageError, match="is not a Gaussian Heritage project"):
        unpack_room(archive, tmp_path / "room")
    assert not (tmp_path / "room").exists()


def test_the_kept_rooms_of_this_repository_stay_small() -> None:
    archives = list((ROOT / KEPT_FOLDER).glob("*.tar.xz"))
    assert sum(archive.stat().st_size for archive in archives) <= MAX_BYTES
    assert {archive.name for archive in archives} <= {f"{room.name}.tar.xz" for room in CHOOSING_ROOMS}


@pytest.mark.parametrize("room", CHOOSING_ROOMS, ids=lambda room: room.name)
def test_a_kept_room_of_this_repository_is_a_project_of_this_version(room: Room, tmp_path: Path) -> None:
    project = unpack_room(ROOT / KEPT_FOLDER / f"{room.name}.tar.xz", tmp_path / "room")
    context = load_context(ProjectFolder.open_existing(project), BETTER, FakeDetector, FakeSam)
    assert set(context.label_maps) == set(context.views.cameras.by_photo) != set()
    assert read_photo_set(project / "photos" / "photos.json").folder == tmp_path / "room" / "photos"
