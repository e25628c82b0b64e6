"""`reconstruct`: whatever lies in the folder, a person gets a scene or one clear sentence, and nothing is lost."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.project.folder import ProjectFolder
from tests.engine.command_line import Answer, call, call_alone
from tests.engine.museum import VIEWS, picture, write_cameras, write_photos

Run = Callable[..., Answer]
Again = Callable[[Path], Answer]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return write_photos(tmp_path / "photos")


@pytest.fixture
def cameras(tmp_path: Path) -> Path:
    return write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, cameras: Path) -> Run:
    """Reconstruct with given cameras and little work."""

    def reconstruct(photos: Path, *more: object, out: Path = tmp_path / "scene") -> Answer:
        return call(capsys, "reconstruct", photos, "--out", out, "--preset", "test", "--cameras", cameras, *more)

    return reconstruct


@pytest.fixture
def again(capsys: pytest.CaptureFixture[str], museum: Path) -> Again:
    """Reconstruct the finished scene of `museum` again, from its photos or others."""

    def reconstruct(photos: Path) -> Answer:
        options = ("--preset", "test", "--cameras", museum / "transforms.json", "--no-objects")
        return call(capsys, "reconstruct", photos, "--out", museum / "scene", *options)

    return reconstruct


def figures(scene: Path, stage: str) -> dict[str, object]:
    return json.loads((scene / "project.json").read_text(encoding="utf-8"))["stages"][stage]["figures"]


def noise(path: Path, seed: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    Image.fromarray(pixels).resize((320, 240), Image.Resampling.BILINEAR).save(path)


def test_folder_without_images_says_what_is_read(tmp_path: Path, run: Run) -> None:
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "thesis.docx").write_text("precious")
    error = run(tmp_path / "papers").error
    assert "There are no photos in" in error and "JPEG" in error


def test_corrupt_photo_among_good_ones_is_named_once_and_left_out(photos: Path, tmp_path: Path, run: Run) -> None:
    whole = (photos / "view_08.jpg").read_bytes()
    (photos / "view_08.jpg").write_bytes(whole[: len(whole) // 2])
    (photos / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 not a photo")
    answer = run(photos, "--no-objects")
    assert answer.code == 0
    named = [event["message"].split()[0] for event in answer.of_kind("warning") if "is not used" in event["message"]]
    assert sorted(named) == ["broken.jpg", "view_08.jpg"]
    assert figures(tmp_path / "scene", "training")["n_gaussians"]


def test_photos_that_do_not_overlap_name_the_likely_causes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "photos").mkdir()
    for i in range(4):
        noise(tmp_path / "photos" / f"{i}.png", i)
    answer = call(capsys, "reconstruct", tmp_path / "photos", "--out", tmp_path / "scene")
    assert "overlap" in answer.error
    assert list(json.loads((tmp_path / "scene" / "project.json").read_text())["stages"]) == ["photos"]


def test_photos_of_all_kinds_sizes_and_names_become_one_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "Fotos für morgen"
    folder.mkdir()
    picture(6, (192, 144)).convert("CMYK").save(folder / "a b.jpg", quality=95)
    picture(7, (192, 144)).convert("L").save(folder / "größe.png")
    picture(8, (240, 180)).save(folder / "a.jpg", quality=95)
    picture(9, (320, 240)).convert("RGBA").save(folder / "a.png")
    gray = np.asarray(picture(10, (192, 144)).convert("L")).astype(np.uint16) * 257
    Image.fromarray(gray).save(folder / "日本.tif")
    names = {"a b.jpg": 6, "größe.png": 7, "a.jpg": 8, "a.png": 9, "日本.tif": 10}
    model = write_cameras(folder, names)
    answer = call(
        capsys, "reconstruct", folder, "--out", tmp_path / "scene", "--preset", "test", "--cameras", model,
        "--no-objects",
    )  # fmt: skip
    assert answer.code == 0
    assert answer.of_kind("warning") == []
    assert figures(tmp_path / "scene", "photos") == {"n_photos": 5, "rejected": []}
    for name in names:
        out = tmp_path / "views" / f"{name}.png"
        assert call(capsys, "render", tmp_path / "scene", "--view", name, "--out", out).code == 0
        with Image.open(folder / name) as photo, Image.open(out) as rendered:
            assert rendered.size == photo.size


def test_photos_changed_before_a_resume_are_taken_as_they_are_now(museum: Path, again: Again) -> None:
    photos, scene = museum / "photos", (museum / "scene" / "gaussians" / "scene.ply").read_bytes()
    assert again(photos).computed == []
    picture(9, (192, 144)).transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(photos / "view_09.jpg")
    assert again(photos).computed == ["photos", "cameras", "training", "report"]
    assert (museum / "scene" / "gaussians" / "scene.ply").read_bytes() != scene
    (photos / "view_09.jpg").unlink()
    assert again(photos).code == 0
    assert figures(museum / "scene", "cameras")["n_registered"] == 4


def test_given_cameras_without_an_error_leave_strict_json(museum: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    for file in ("project.json", "cameras/cameras.json", "report/report.json"):
        json.loads((museum / "scene" / file).read_text(encoding="utf-8"), parse_constant=refuse)
    assert figures(museum / "scene", "cameras")["reprojection_error"] is None


def test_project_inside_the_photo_folder_is_not_taken_for_photos(photos: Path, run: Run) -> None:
    assert run(photos, "--no-objects", out=photos / "scene").code == 0
    assert run(photos, "--no-objects", out=photos / "scene").computed == []
    assert figures(photos / "scene", "photos")["n_photos"] == len(VIEWS)


def test_mistyped_photo_folder_leaves_the_scene_as_it_was(museum: Path, again: Again) -> None:
    before = (museum / "scene" / "project.json").read_bytes()
    assert "does not exist" in again(museum / "fotos").error
    assert (museum / "scene" / "project.json").read_bytes() == before


def test_scene_of_other_photos_is_never_overwritten(museum: Path, again: Again) -> None:
    before = (museum / "scene" / "project.json").read_bytes()
    (museum / "others").mkdir()
    for i in range(3):
        noise(museum / "others" / f"{i}.png", i)
    error = again(museum / "others").error
    assert "holds the scene of other photos" in error and "Choose another folder" in error
    assert (museum / "scene" / "project.json").read_bytes() == before
    (museum / "photos").rename(museum / "moved")
    assert again(museum / "moved").computed == []
    assert json.loads((museum / "scene" / "project.json").read_text())["photo_folder"] == str(museum / "moved")


def test_second_job_on_one_folder_is_refused(photos: Path, tmp_path: Path, run: Run) -> None:
    with ProjectFolder.create(tmp_path / "scene"):
        assert "Another job is working in" in run(photos, "--no-objects").error
    assert run(photos, "--no-objects").code == 0


def test_prompts_that_name_nothing_are_refused_before_any_work(photos: Path, tmp_path: Path, run: Run) -> None:
    answer = run(photos, "--prompts", " ; ")
    assert answer.code == 2
    assert "names no object" in answer.error
    assert not (tmp_path / "scene").exists()


def test_missing_model_file_names_the_command_and_keeps_what_is_done(
    photos: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    answer = run(photos)
    assert answer.computed == ["photos", "cameras"]
    assert "is missing. Run: python -m engine models fetch" in answer.error
    assert run(photos).computed == []


def test_interpreter_without_torch_is_a_sentence(photos: Path, cameras: Path, tmp_path: Path) -> None:
    answer = call_alone(
        "reconstruct", photos, "--out", tmp_path / "scene", "--cameras", cameras, "--no-objects", "--preset", "test",
        before="sys.modules['torch'] = None",
    )  # fmt: skip
    assert "has no package 'torch'" in answer.error and sys.executable in answer.error
    assert answer.computed == ["photos"], "said before the cameras are looked for, which may take long"


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
@pytest.mark.parametrize("given", [True, False], ids=["while training", "while finding cameras"])
def test_full_disk_is_a_sentence_and_the_next_run_continues(
    tmp_path: Path, cameras: Path, capsys: pytest.CaptureFixture[str], given: bool
) -> None:
    photos = write_photos(tmp_path / "photos", size=(192, 144) if given else (480, 360))
    command = ["reconstruct", photos, "--out", tmp_path / "scene", "--no-objects", "--preset", "test"]
    command += ["--cameras", cameras] if given else []
    # A limit on the size of files stands in for a full disk: writing fails at the same places, with a like error.
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))"
    answer = call_alone(*command, before=limit)
    (event,) = answer.of_kind("error")
    assert event["error"] == "DiskError"
    assert "run again" in answer.error or "Free some space" in answer.error
    assert not [path for path in (tmp_path / "scene").rglob("*") if path.name.startswith(".writing-")]
    again = call(capsys, *command)
    assert again.code == 0
    assert "photos" not in again.computed


def test_forecast_made_before_the_work_is_kept_beside_what_it_took(museum: Path, again: Again) -> None:
    stored = json.loads((museum / "scene" / "project.json").read_text(encoding="utf-8"))
    stages = [stage["stage"] for stage in stored["forecast"]["stages"]]
    assert stages == ["photos", "cameras", "training", "report"]
    assert set(stages) == set(stored["stages"])
    assert stored["work_plan"]["preset"] == "test"
    assert all("peak_memory" in record and not record["continued"] for record in stored["stages"].values())
    before = stored["forecast"]
    assert again(museum / "photos").computed == []
    stored = json.loads((museum / "scene" / "project.json").read_text(encoding="utf-8"))
    assert stored["forecast"] == before
