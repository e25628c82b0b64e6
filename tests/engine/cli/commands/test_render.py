"""`render --device`: the graphics card where one works, the processor elsewhere, and a sentence that says which."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.cameras import covering_pinhole
from engine.masks import mask_iou
from engine.pictures.render import render_view
from engine.project.objects import ObjectRecord, save_object
from engine.rasterizer.gpu import Gpu
from engine.scene import PinholeCamera
from tests.engine.command_line import Answer, call
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene

SENTENCE = "tests use no graphics card"


def render(capsys: pytest.CaptureFixture[str], scene: Path, out: Path, *more: str) -> Answer:
    return call(capsys, "render", scene, "--view", "view_1.png", "--out", out, "--overwrite", *more)


@pytest.mark.parametrize("what", ["rgb", "depth", "features"])
def test_card_renders_the_picture_of_the_processor(
    what: str, card: Gpu, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = []
    for device in ("auto", "cpu"):
        answer = render(capsys, scene, tmp_path / f"{device}.png", "--device", device, "--what", what)
        (finished,) = answer.of_kind("finished")
        name = f"{card.name} ({card.backend})" if device == "auto" else "cpu"
        assert finished["outputs"]["device"] == name and f"It was rendered on {name}." in finished["message"]
        pictures.append(np.asarray(Image.open(tmp_path / f"{device}.png")).astype(int))
    difference = np.abs(pictures[0] - pictures[1])
    # Both round float32 values that differ in the last digits; single pixels lie on a threshold of the blending.
    assert np.quantile(difference, 0.999) <= 1 and np.mean(difference > 0) <= 0.01


def test_without_a_card_the_processor_renders_and_the_sentence_says_why(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (finished,) = render(capsys, scene, tmp_path / "out.png").of_kind("finished")
    assert finished["message"].endswith(f"It was rendered on cpu, because {SENTENCE}.")
    assert (tmp_path / "out.png").exists()


def test_several_views_and_objects_are_rendered_in_one_call(
    blobs: BlobScene, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, part in (("ball", RED), ("twin", TWIN)):
        members = (blobs.part == part).astype(np.float32)
        record = ObjectRecord(name, name, {"kind": "click"}, 0.5, 1.0, 1.0, int(members.sum()), len(members))
        save_object(scene, record, members)
    wanted = ["--view", "view_1.png", "--view", "view_3.png", "--object", "ball", "--object", "twin", "--what", "mask"]
    answer = call(capsys, "render", scene, *wanted, "--out", tmp_path / "pictures")
    (finished,) = answer.of_kind("finished")
    names = ["view_1-ball.png", "view_1-twin.png", "view_3-ball.png", "view_3-twin.png"]
    assert [Path(file).name for file in finished["outputs"]["files"]] == names
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == names
    for name, part in zip(names, (RED, TWIN, RED, TWIN), strict=True):
        shown = np.asarray(Image.open(tmp_path / "pictures" / name)) > 0
        truth = blobs.labels[f"{name.split('-')[0]}.png"] == part
        assert mask_iou(shown, truth) > 0.8
    assert "already exists" in call(capsys, "render", scene, *wanted, "--out", tmp_path / "pictures").error
    assert "Choose a folder" in call(capsys, "render", scene, *wanted, "--out", tmp_path / "one.png").error


def test_click_in_any_rendered_view_gives_the_mask_of_the_object_there(
    blobs: BlobScene, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = blobs.cameras.cameras[1]
    frame = covering_pinhole(photo)
    K = {"fx": frame.K[0, 0], "fy": frame.K[1, 1], "cx": frame.K[0, 2], "cy": frame.K[1, 2]}
    moved = frame.viewmat.copy()
    moved[2, 3] += 0.15  # farther away than any photo
    camera = {"width": frame.width, "height": frame.height, **K, "viewmat": moved.tolist()}
    (tmp_path / "away.json").write_text(json.dumps(camera))
    x, y, depth = moved[:3, :3] @ np.median(blobs.gaussians.means[blobs.part == BLUE], axis=0) + moved[:3, 3]
    click = f"{K['fx'] * x / depth + K['cx']:.1f},{K['fy'] * y / depth + K['cy']:.1f}"
    out = tmp_path / "mask.png"
    arguments = ("--camera", tmp_path / "away.json", "--what", "mask", "--click", click, "--out", out)
    assert call(capsys, "render", scene, *arguments).code == 0
    shown = np.asarray(Image.open(out)) > 0
    elsewhere = PinholeCamera(moved, frame.K, frame.width, frame.height)
    truth = render_view(blobs.gaussians, elsewhere, what="mask", members=blobs.part == BLUE) > 0
    assert mask_iou(shown, truth) > 0.9
    outside = call(capsys, "render", scene, *arguments[:-3], "9999,1", "--out", tmp_path / "other.png")
    assert "outside of the picture" in outside.error and outside.code != 0


def test_card_that_is_demanded_and_missing_is_one_sentence(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = render(capsys, scene, tmp_path / "out.png", "--device", "gpu")
    assert answer.code != 0 and SENTENCE in answer.error
    assert not (tmp_path / "out.png").exists()


def test_picture_too_large_for_the_card_says_what_to_lower(
    card: Gpu,
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 100_000)
    answer = render(capsys, scene, tmp_path / "out.png", "--device", "gpu")
    assert "160 x 120 pixels needs" in answer.error and "render a smaller picture" in answer.error
    (finished,) = render(capsys, scene, tmp_path / "out.png").of_kind("finished")
    assert "It was rendered on cpu, because this picture of 160 x 120 pixels needs" in finished["message"]
