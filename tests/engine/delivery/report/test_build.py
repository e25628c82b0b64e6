from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.core.files import file_sha256
from engine.delivery.report.build import build_report
from engine.delivery.report.plots import compare_curves, error_curve
from engine.delivery.report.views import best_seen_from, orbit_cameras
from engine.masks.storage import label_map_path, write_label_map
from engine.pictures.scene import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, save_object
from engine.project.provenance import describe_run
from engine.scene import Photo, PhotoSet, write_photo_set
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
            "fitted_psnr": 26.5,
            "well_seen_psnr": 27.5,
            "well_seen_share": 0.8,
            "dark_share": 0.025,
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
    page = build_report(project)[0]
    assert page == project.path / "report" / "report.html"
    checker = read(page)
    assert checker.pictures == 2 * 3 + 4
    for words in (
        "<b>Kugel & Co", "blurred.png", "It is <blurred>.", "lost.png", "0.61 px", "a lens model per photo",
        "7 rotations of length zero reset",
        "200 at the largest elongation", "'unicorn' is not known.", "25.0 dB", "torch", "estimated", "3.2 s",
        "PSNR on test photos", "26.5 dB", "27.5 dB (80% of the pixels)", "2.5%",
        "pale where it shows what fewer than three training photos see",
    ):  # fmt: skip
        assert words in checker.text, words
    assert "gradient was not finite" not in checker.text, "a guard that never fired is not listed"


def test_report_is_written_in_german_too_with_the_same_pictures_and_names(project: ProjectFolder) -> None:
    english, german = build_report(project)
    assert german == project.path / "report" / "report_de.html"
    assert '<html lang="de">' in german.read_text(encoding="utf-8")
    checker = read(german)
    assert checker.pictures == read(english).pictures
    for words in (
        "<b>Kugel & Co", "blurred.png", "verwendete Fotos", "PSNR an Testfotos", "27.5 dB (80% der Pixel)",
        "Nicht verwendet", "7 Drehungen der Länge null zurückgesetzt", "Die Szene wird aufgebaut", "Suchwort „ball“",
        "Übereinstimmung mit seiner Maske 0.95", "Fehler über der Laufzeit", "ein Objektivmodell je Foto",
    ):  # fmt: skip
        assert words in checker.text, words
    assert "Photos" not in checker.text and "Objects" not in checker.text


def test_report_says_first_that_the_photos_refute_their_cameras(project: ProjectFolder) -> None:
    figures = dict((project.stage_record("cameras") or {})["figures"])
    figures["health"] = {"colour": "green", "cause": "", "sentence": "All is well.", "refuted": []}
    project.finish_stage("cameras", "key", wall_seconds=1.0, cpu_seconds=1.0, figures=figures)
    text = read(build_report(project)[0]).text
    assert "green" in text and "All is well." not in text
    figures["health"] = {"colour": "red", "cause": "mirrored", "sentence": "Flip <them> back.", "refuted": ["a.jpg"]}
    project.finish_stage("cameras", "key", wall_seconds=1.0, cpu_seconds=1.0, figures=figures)
    text = read(build_report(project)[0]).text
    assert text.index("Flip <them> back.") < text.index("photos used")


def test_report_says_when_with_what_and_from_what_it_was_made(project: ProjectFolder) -> None:
    photo = Photo("view_0.png", 160, 120, None, "ab" * 32)
    write_photo_set(project.path / "photos" / "photos.json", PhotoSet(Path("photos"), (photo,), ()))
    training = project.stage_record("training") or {}
    run = {**describe_run({"seed": 11}), "commit": "c0ffee" * 6 + "c0ff", "changed": False}
    project.finish_stage(
        "training", "key", wall_seconds=1.0, cpu_seconds=1.0, figures=training["figures"], run=run,
        outputs=[project.path / "gaussians" / "scene.ply"],
    )  # fmt: skip
    text = read(build_report(project)[0]).text
    for words in (run["finished"], "commit c0ffeec0ffee", "Building the scene 11", "unit of length", "ab" * 32):
        assert words in text, words
    assert "is not known, because no distance was given" in text
    assert "not measured" not in text
    assert file_sha256(project.path / "gaussians" / "scene.ply") in text


@pytest.mark.parametrize(("fit", "is_marked"), [(0.79, True), (0.81, False)])
def test_object_that_agrees_little_with_its_mask_is_marked(project: ProjectFolder, fit: float, is_marked: bool) -> None:
    file = project.path / "objects" / "b" / "object.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps({**data, "fit": fit}), encoding="utf-8")
    assert ("Low agreement with its mask" in read(build_report(project)[0]).text) == is_marked


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


def test_report_of_a_run_without_masks_objects_and_test_photos(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path, features=False)
    figures = {"curve": [{**CURVE[-1], "psnr": float("nan")}], "held_out": [], "measured_photos": ["view_1.png"]}
    project.finish_stage("training", "key", wall_seconds=5.0, cpu_seconds=9.0, figures=figures)
    checker = read(build_report(project)[0])
    assert "No object was isolated yet." in checker.text and "too few photos for test photos" in checker.text


def test_report_of_an_empty_project_says_what_is_missing(tmp_path: Path) -> None:
    checker = read(build_report(ProjectFolder.create(tmp_path / "project"))[0])
    assert "Not done yet: Reading the photos" in checker.text


def test_photo_that_is_gone_costs_only_its_picture(project: ProjectFolder, tmp_path: Path) -> None:
    (tmp_path / "photos" / "view_0.png").unlink()
    assert read(build_report(project)[0]).pictures == 3 + 4


def test_object_of_an_earlier_training_is_named_without_pictures(project: ProjectFolder, blobs: BlobScene) -> None:
    from engine.training.scene_files import save_gaussians

    save_gaussians(project.path / "gaussians", blobs.gaussians[:900])
    checker = read(build_report(project)[0])
    assert checker.pictures == 2 * 3 and "Kugel" in checker.text


def test_curve_needs_two_measured_points() -> None:
    assert error_curve(CURVE[:1], str) == error_curve([], str) == ""
    assert error_curve([*CURVE, {"wall_seconds": 30.0, "psnr": None}], str).startswith("<svg")


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


def test_report_shows_the_plan_and_what_it_forecast_beside_what_it_took(project: ProjectFolder) -> None:
    before = {"seconds": 45.0, "low": 30.0, "high": 70.0, "memory": 9e8, "memory_low": 8e8, "memory_high": 1e9}
    project.put("forecast", {"stages": [{"stage": stage, **before} for stage in ("training", "report")]})
    plan = {
        "width": 640, "height": 480, "pairs": "promising", "n_pairs": 201, "n_mask_photos": 8, "max_gaussians": 40_000,
        "sh_degree": 1, "features": True, "exposure": False, "steps": 3000,
    }  # fmt: skip
    project.put("work_plan", plan)
    stopped = {
        "planned_steps": 3000, "expected_gain": 0.02, "limit": 0.05, "wall_seconds_saved": 33.4, "cpu_seconds_saved": 60
    }  # fmt: skip
    training = {"curve": CURVE, "steps": 2700, "stopped_early": stopped, "preset": "standard", "n_gaussians": 950}
    training["sh_degree"] = 0
    training["validation_photos"] = ["view_2.png"]
    training["trials"] = [
        {"what": "1", "step": 1500, "n_steps": 150, "gain": 0.012, "kept": False},
        {"what": "exposure", "step": 750, "n_steps": 150, "gain": 0.4, "kept": True},
    ]
    project.finish_stage(
        "training", "key", wall_seconds=61.0, cpu_seconds=100.0, figures=training, peak_memory=870_000_000
    )
    text = read(build_report(project)[0]).text
    for words in (
        "640 x 480", "promising ones, about 201", "45 s (30 s to 70 s)", "61 s", "0.90 GB (0.80 GB to 1.00 GB)",
        "0.87 GB", "being written", "300 of 3,000 training steps", "Saved: about 33 s",
        "view-dependent colour above 0", "+0.01 dB on the validation photos", "0 of 1",
    ):  # fmt: skip
        assert words in text, words
    assert "nothing left out" not in text
    assert "the brightness correction per photo" not in text
    project.put("measured_savings", {"standard": {"training_cpu_seconds": 120.0, "psnr_lost": 0.04}})
    text = read(build_report(project)[0]).text
    assert "120 CPU s of training saved, at 0.04 dB less" in text


def test_report_of_a_stage_that_was_continued_does_not_judge_its_forecast(project: ProjectFolder) -> None:
    before = {"seconds": 45.0, "low": 30.0, "high": 70.0, "memory": 9e8, "memory_low": 8e8, "memory_high": 1e9}
    project.put("forecast", {"stages": [{"stage": "masks", **before}]})
    project.put("work_plan", {
        "width": 64, "height": 48, "pairs": "none", "n_pairs": 0, "n_mask_photos": 8, "max_gaussians": 400,
        "sh_degree": 0, "features": True, "exposure": True, "steps": 60,
    })  # fmt: skip
    project.finish_stage("masks", "key", wall_seconds=5.0, cpu_seconds=9.0, figures={}, continued=True)
    text = read(build_report(project)[0]).text
    assert "5.0 s (continued)" in text and "unknown" in text
    beside = {"beside": {"seconds": 42.0, "n_kept": 0, "peak_memory": 1_800_000_000, "problem": ""}}
    project.finish_stage("masks", "key", wall_seconds=0.1, cpu_seconds=9.0, figures=beside, peak_memory=500_000_000)
    text = read(build_report(project)[0]).text
    assert "0.1 s after 42 s while the cameras were estimated" in text and "1.80 GB" in text


def test_picture_of_several_presets_shows_what_was_measured() -> None:
    assert compare_curves([("a", CURVE), ("b", CURVE[:2])], [(25.0, 25.0)]).startswith(b"\x89PNG")
    assert compare_curves([("a", [])], []) == b""


def test_sheet_shows_every_object_from_four_sides_with_clean_edges(project: ProjectFolder) -> None:
    from PIL import Image

    from engine.delivery.report.sheet import PAPER_WHITE

    build_report(project)
    with Image.open(project.path / "report" / "objects.png") as picture:
        sheet = np.asarray(picture.convert("RGB"), np.int32)
    ground = np.rint(255 * np.asarray(PAPER_WHITE)).astype(int)
    different = np.abs(sheet - ground).max(axis=2) > 40
    columns = np.array_split(different[60:], 4, axis=1)
    assert all(0.05 < column.mean() < 0.9 for column in columns)
    blue = (sheet[..., 2] > sheet[..., 0] + 60) & different
    assert blue.sum() > 0.8 * different[60:].sum(), "the ball alone, without what stands around it"


def test_sheet_of_nothing_is_none() -> None:
    from engine.delivery.report.sheet import picture_sheet

    assert picture_sheet([("a", [])]) is None


def test_objects_are_shown_from_where_nothing_hides_them(blobs: BlobScene) -> None:
    cameras = blobs.cameras.cameras
    ball, twin = blobs.part == BLUE, blobs.part == 2
    # A wall before the first camera, and one Gaussian of the ball that only a camera turned away sees.
    means, log_scales = blobs.gaussians.means.copy(), blobs.gaussians.log_scales.copy()
    middle = np.median(means[ball], axis=0)
    wall = np.flatnonzero(twin)[:40]
    means[wall] = 0.5 * cameras[0].center + 0.5 * middle
    log_scales[wall] = np.log(0.3)
    turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    away = replace(cameras[4], photo="away.png", viewmat=turn @ cameras[4].viewmat)
    stray = np.flatnonzero(ball)[0]
    means[stray] = cameras[4].center - 1.5 * cameras[4].viewmat[2, :3]
    scene = Scene(replace(blobs.gaussians, means=means.astype(np.float32), log_scales=log_scales))
    (seen, unseen) = best_seen_from(scene, [ball, np.zeros_like(ball)], [*cameras, away])
    photos = {camera.photo for camera in seen}
    assert photos and "away.png" not in photos and cameras[0].photo not in photos
    assert unseen == []


def test_sides_that_are_nearly_one_are_spread_by_forty_degrees(blobs: BlobScene) -> None:
    points = blobs.gaussians.means[blobs.part == BLUE]
    away = np.stack(
        [camera.center - points.mean(axis=0) for camera in orbit_cameras(points, blobs.cameras.cameras[:1])]
    )
    assert np.ptp(np.unwrap(np.arctan2(away[:, 1], away[:, 0]))) == pytest.approx(np.radians(40), abs=0.05)


def test_what_hangs_on_a_wall_is_shown_from_where_the_photos_were_taken(blobs: BlobScene) -> None:
    points = blobs.gaussians.means[blobs.part == BLUE]
    middle = points.mean(axis=0)
    cameras = blobs.cameras.cameras[:3]

    def angles(centers: list[np.ndarray]) -> np.ndarray:
        away = np.stack(centers)[:, :2] - middle[:2]
        return np.unwrap(np.sort(np.arctan2(away[:, 1], away[:, 0])))

    photographed, shown = (
        angles([camera.center for camera in cameras]),
        angles([camera.center for camera in orbit_cameras(points, cameras)]),
    )
    assert np.ptp(shown) <= np.ptp(photographed) + 1e-6
    assert np.ptp(shown) > 0.8 * np.ptp(photographed)


HOSTILE = "<script>alert(1)</script>\"'&\x1b\u202e"


class Tags(HTMLParser):
    """All elements and the names of their attributes; the values of attributes that can load or run something."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[tuple[str, str]] = set()
        self.targets: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {(tag, name) for name, _ in attrs}
        self.targets |= {
            (value or "").partition(",")[0] for name, value in attrs if name in ("src", "href", "action", "data")
        }


def with_every_text(value: object, text: str) -> object:
    """Return a JSON value with every text in it replaced."""
    if isinstance(value, dict):
        return {key: with_every_text(item, text) for key, item in value.items()}
    if isinstance(value, list):
        return [with_every_text(item, text) for item in value]
    return text if isinstance(value, str) else value


PLAN = {
    "width": 640, "height": 480, "pairs": "promising", "n_pairs": 201, "n_mask_photos": 8, "max_gaussians": 40_000,
    "sh_degree": 1, "features": True, "exposure": False, "steps": 3000,
}  # fmt: skip
COST = {"seconds": 45.0, "low": 30.0, "high": 70.0, "memory": 9e8, "memory_low": 8e8, "memory_high": 1e9}


def planned(project: ProjectFolder) -> ProjectFolder:
    """The project with everything that the report can show."""
    project.put("forecast", {"stages": [{"stage": stage, **COST} for stage in ("training", "report")]})
    project.put("work_plan", PLAN)
    project.put("measured_savings", {"standard": {"training_cpu_seconds": 120.0, "psnr_lost": 0.04}})
    training = dict((project.stage_record("training") or {})["figures"])
    training["trials"] = [{"what": "1", "step": 1500, "n_steps": 150, "gain": 0.012, "kept": False}]
    project.finish_stage("training", "key", wall_seconds=61.0, cpu_seconds=100.0, figures=training)
    return project


def test_report_says_in_its_language_why_no_card_trained(project: ProjectFolder) -> None:
    reason = "this computer has no graphics card with Vulkan, Metal or DirectX 12"
    project.put("work_plan", {**PLAN, "device": {"name": "cpu", "reason": reason}})
    training = dict((project.stage_record("training") or {})["figures"])
    project.finish_stage("training", "key", wall_seconds=61.0, cpu_seconds=100.0, figures={**training, "device": "cpu"})
    english, german = (read(page).text for page in build_report(project))
    assert f"the processor, because {reason}" in english
    assert "Prozessor (Grund: dieser Computer hat keine Grafikkarte mit Vulkan" in german


def test_no_text_of_a_project_becomes_part_of_the_page(project: ProjectFolder) -> None:
    healthy = Tags(build_report(planned(project))[0])
    for stage in ("photos", "cameras", "masks", "training", "objects"):
        record = project.stage_record(stage) or {}
        figures = with_every_text(record["figures"], HOSTILE)
        if stage == "training":
            # The names of photos are looked up; those of guards are shown.
            figures |= {"held_out": ["view_0.png", HOSTILE], "guards": {HOSTILE: 7}}  # type: ignore[operator]
        project.finish_stage(stage, HOSTILE, wall_seconds=61.0, cpu_seconds=100.0, figures=figures)  # type: ignore[arg-type]
    for name in ("work_plan", "forecast", "plan"):
        project.put(name, with_every_text(project.get(name), HOSTILE))
    project.put("photo_folder", str(Path(str(project.get("photo_folder"))).parent / HOSTILE.replace("/", "")))
    for file in project.path.glob("objects/*/object.json"):
        data = json.loads(file.read_text(encoding="utf-8"))
        data["name"], data["prompt"] = HOSTILE, {"kind": HOSTILE, "text": HOSTILE, "photo": HOSTILE}
        file.write_text(json.dumps(data), encoding="utf-8")
    page = build_report(project)[0]
    hostile = Tags(page)
    assert hostile.tags <= healthy.tags and "script" not in hostile.tags
    assert hostile.attributes <= healthy.attributes
    assert hostile.targets <= healthy.targets
    text = page.read_text(encoding="utf-8")
    assert "<script" not in text and "alert(1)" in text, "the texts are shown"
    assert "\x1b" not in text and "\u202e" not in text


@pytest.mark.parametrize(
    ("stage", "figures"),
    [
        ("training", {"curve": 7}),
        ("training", {"curve": [7]}),
        ("training", {"curve": [{"psnr": "x"}]}),
        ("training", {"held_out": "view_0.png"}),
        ("training", {"validation_photos": "view_0.png"}),
        ("training", {"guards": {"reset_rotations": []}}),
        ("training", {"trials": [{"what": 7}]}),
        ("training", {"stopped_early": {}}),
        ("photos", {"rejected": [{"name": "a"}]}),
        ("cameras", {"unregistered": [7]}),
        ("masks", {"n_photos": "8"}),
        ("objects", {"refused": []}),
    ],
)
def test_damaged_figures_are_one_sentence(project: ProjectFolder, stage: str, figures: dict[str, object]) -> None:
    project.finish_stage(stage, "key", wall_seconds=1.0, cpu_seconds=1.0, figures=figures)
    with pytest.raises(FormatError, match=rf"project\.json cannot be read: `stages\.{stage}\.figures\."):
        build_report(project)


@pytest.mark.parametrize("plan", [{}, {**PLAN, "width": "640"}, {**PLAN, "pairs": {}}, []])
def test_a_damaged_plan_is_one_sentence(project: ProjectFolder, plan: object) -> None:
    project.put("work_plan", plan)
    with pytest.raises(FormatError, match=r"project\.json cannot be read: `work_plan"):
        build_report(project)


def test_picture_from_outside_of_the_photo_folder_is_not_shown(project: ProjectFolder, tmp_path: Path) -> None:
    """A link of a project that was sent could lead to any picture of the computer."""
    view = tmp_path / "photos" / "view_0.png"
    view.rename(tmp_path / "private.png")
    view.symlink_to(tmp_path / "private.png")
    assert read(build_report(project)[0]).pictures == 3 + 4


def test_numbers_that_cannot_be_drawn_are_left_out() -> None:
    assert error_curve([{**point, "psnr": 1e308} for point in CURVE], str).startswith("<svg")
    assert error_curve([{**point, "wall_seconds": 1e300} for point in CURVE], str) == ""
