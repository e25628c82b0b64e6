from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from engine.masks.storage import label_map_path, write_label_map
from engine.objects.storage import ObjectRecord, save_object
from engine.project_folder import ProjectFolder
from engine.report.build import build_report
from engine.report.plots import error_curve
from engine.report.views import orbit_cameras
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, BlobScene

CURVE = [
    {"step": 100 * i, "wall_seconds": 3.0 * i, "cpu_seconds": 5.0 * i, "psnr": 15.0 + 2 * i, "ssim": 0.5 + 0.08 * i,
     "l1": 0.2 / (i + 1), "n_gaussians": 500 + 100 * i}
    for i in range(6)
]  # fmt: skip


class Checker(HTMLParser):
    """Counts pictures and what the page would load from elsewhere, and sees that tags are closed."""

    VOID = ("meta", "img", "br", "path", "use", "rect", "clippath", "link")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.pictures = 0
        self.foreign: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        source = dict(attrs).get("src") or ""
        self.pictures += tag == "img"
        if tag in ("img", "script", "link") and not source.startswith("data:"):
            self.foreign.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def read(page: Path) -> Checker:
    checker = Checker()
    checker.feed(page.read_text(encoding="utf-8"))
    checker.close()
    assert not checker.open and not checker.foreign
    return checker


@pytest.fixture
def project(blobs: BlobScene, tmp_path: Path) -> ProjectFolder:
    """A finished project with one object, whose name is trying to break the page."""
    project = trained_project(blobs, tmp_path)
    done = {
        "photos": {"n_photos": 9, "rejected": [{"name": "blurred.png", "reason": "It is <blurred>."}]},
        "cameras": {"n_registered": 8, "unregistered": ["lost.png"], "reprojection_error": 0.61, "poses_given": False},
        "masks": {"n_photos": 8, "seconds_per_photo": 3.2},
        "training": {
            "curve": CURVE,
            "held_out": ["view_0.png", "view_4.png"],
            "guards": {"reset_rotations": 7, "refused_steps": 0},
            "limits": {"scales_at_limit": 60_000, "opacities_at_limit": 0},
            "steps": 300,
            "preset": "standard",
            "n_gaussians": 950,
        },
        "objects": {"found": {}, "refused": {"unicorn": "'unicorn' is not known."}},
    }
    for stage, figures in done.items():
        project.finish_stage(stage, "key", wall_seconds=61.0, cpu_seconds=100.0, figures=figures)
    project.put("plan", {"left_out": [{"what": "a lens model per photo", "why": "all photos share one lens"}]})
    for name, labels in blobs.labels.items():
        write_label_map(label_map_path(project.path / "masks", name), labels)
    record = ObjectRecord(
        id="b", name="<b>Kugel & Co", prompt={"kind": "text", "text": "ball"}, threshold=0.5, score=0.9, fit=0.95,
        n_gaussians=150, n_scene_gaussians=950,
    )  # fmt: skip
    save_object(project.path, record, (blobs.part == BLUE).astype(np.float32))
    return project


def test_report_tells_the_whole_story_in_one_file(project: ProjectFolder) -> None:
    page = build_report(project)
    assert page == project.path / "report" / "report.html"
    checker = read(page)
    assert checker.pictures == 2 * 2 + 4
    for words in (
        "<b>Kugel & Co", "blurred.png", "It is <blurred>.", "lost.png", "0.61 px", "a lens model per photo",
        "7 rotations without direction reset",
        "200 at the largest elongation", "'unicorn' is not known.", "25.0 dB", "torch", "estimated", "3.2 s",
    ):  # fmt: skip
        assert words in checker.text, words
    assert "gradient was not finite" not in checker.text, "a guard that never fired is not listed"


def test_numbers_are_kept_as_strict_json(project: ProjectFolder) -> None:
    build_report(project)

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    facts = json.loads((project.path / "report" / "report.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert facts["training"]["curve"][-1]["psnr"] == 25.0
    assert facts["training"]["step_ms"] == pytest.approx(30.0)
    agreement = facts["training"]["feature_agreement"]
    assert agreement["trained"] > 0.8 > 0.3 > agreement["untrained"]
    assert {stage["stage"] for stage in facts["stages"]} == {"photos", "cameras", "masks", "training", "objects"}


def test_report_of_a_run_without_masks_objects_and_held_out_photos(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path, features=False)
    figures = {"curve": [{**CURVE[-1], "psnr": float("nan")}], "held_out": [], "measured_photos": ["view_1.png"]}
    project.finish_stage("training", "key", wall_seconds=5.0, cpu_seconds=9.0, figures=figures)
    checker = read(build_report(project))
    assert "No object was isolated yet." in checker.text and "too few to spare one" in checker.text


def test_report_of_an_empty_project_says_what_is_missing(tmp_path: Path) -> None:
    checker = read(build_report(ProjectFolder.create(tmp_path / "project")))
    assert "Not done yet: reading the photos" in checker.text


def test_photo_that_is_gone_costs_only_its_picture(project: ProjectFolder, tmp_path: Path) -> None:
    (tmp_path / "photos" / "view_0.png").unlink()
    assert read(build_report(project)).pictures == 2 + 4


def test_object_of_an_earlier_training_is_named_without_pictures(project: ProjectFolder, blobs: BlobScene) -> None:
    from engine.gaussians.storage import save_gaussians

    save_gaussians(project.path / "gaussians", blobs.gaussians[:900])
    checker = read(build_report(project))
    assert checker.pictures == 2 * 2 and "Kugel" in checker.text


def test_curve_needs_two_measured_points() -> None:
    assert error_curve(CURVE[:1]) == error_curve([]) == ""
    assert error_curve([*CURVE, {"wall_seconds": 30.0, "psnr": None}]).startswith("<svg")


def test_objects_are_shown_whole_and_from_the_sides_of_the_photos(blobs: BlobScene) -> None:
    points = blobs.gaussians.means[blobs.part == BLUE]
    around = orbit_cameras(points, blobs.cameras.cameras)
    front = orbit_cameras(points, blobs.cameras.cameras[:2])
    for camera in [*around, *front]:
        in_camera = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
        pixels = in_camera @ camera.K.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        assert (in_camera[:, 2] > 0).all() and (pixels > 0).all() and (pixels < camera.width).all()
    middle = points.mean(axis=0)
    photographed = np.mean([camera.center - middle for camera in blobs.cameras.cameras[:2]], axis=0)
    assert all((camera.center - middle)[:2] @ photographed[:2] > 0 for camera in front)
    away = np.stack([camera.center - middle for camera in around])[:, :2].sum(axis=0)
    assert np.linalg.norm(away) < 0.3
