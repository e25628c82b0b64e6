"""Several texts, corrections by clicks, levels and candidates, on the blob scene with fake models that know it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, FormatError, ObjectError, PromptError
from engine.core.events import Event, Progress, Warned
from engine.core.shares import helped_by
from engine.core.words import split_texts
from engine.masks import mask_iou
from engine.objects.candidate_file import CANDIDATES, load_candidate
from engine.objects.context import load_context
from engine.objects.grounding.detector import PromptCheck
from engine.objects.looks import load_or_build_looks
from engine.objects.prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, parse_prompt
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder
from engine.project.objects import (
    ObjectRecord,
    delete_object,
    list_objects,
    list_trash,
    load_levels,
    load_membership,
    load_object,
    restore_object,
    save_object,
)
from engine.project.refused_prompts import read_not_found
from engine.scene.detailed import load_detailed
from engine.training.scene_files import save_gaussians
from tests.conftest import ROOT
from tests.engine.core.helper_here import HelperHere
from tests.engine.objects.fakes import FakeDetector, FakeSam, box_of, copied_project, segmenter_of, trained_project
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene

SMALL = replace(BETTER, photo_side=160, render_side=160, detail_steps=3)


@pytest.fixture(scope="module")
def looked_at(blobs: BlobScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a project whose graph and looks are made, as the first text makes them."""
    folder = tmp_path_factory.mktemp("looked at")
    project = trained_project(blobs, folder)
    load_or_build_looks(load_context(project, SMALL, lambda: FakeDetector(blobs), lambda: FakeSam(blobs)))  # type: ignore[arg-type, return-value]
    return folder


@pytest.fixture
def project(looked_at: Path, tmp_path: Path) -> ProjectFolder:
    return copied_project(looked_at, tmp_path)


def point(scene: BlobScene, part: int, photo: str) -> Point:
    return Point(photo, *scene.center_of(part, photo))


def members(project: ProjectFolder, name: str) -> np.ndarray:
    return load_membership(project.path, name) >= 0.5


def test_several_texts_are_reported_one_by_one(blobs: BlobScene, project: ProjectFolder) -> None:
    events: list[Event] = []
    texts = split_texts("blue ball; ghost;astrolabe;blue ball")
    assert texts == ["blue ball", "ghost", "astrolabe"]
    records, refused = segmenter_of(project, blobs, SMALL, emit=events.append).segment_texts(texts, None)
    assert [record.name for record in records] == ["blue ball"] and list(refused) == ["ghost", "astrolabe"]
    assert "not known" in refused["astrolabe"] and "was not found" in refused["ghost"]
    assert [event.message for event in events if isinstance(event, Warned)] == list(refused.values())


def test_text_that_means_a_stored_object_is_told_as_that_object(blobs: BlobScene, project: ProjectFolder) -> None:
    """Two words may be of the same class, as vase and amphora are."""

    class Synonyms(FakeDetector):
        def check_prompt(self, prompt):  # type: ignore[no-untyped-def]
            return super().check_prompt(prompt.replace("sphere", "ball"))

        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return super().score_descriptions(described, prompt.replace("sphere", "ball"))

    def ask(*texts: str) -> tuple[list[str], list[str]]:
        events: list[Event] = []
        asking = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Synonyms(blobs), emit=events.append)
        records, _ = asking.segment_texts(texts, None)
        return [one.id for one in records], [event.message for event in events if isinstance(event, Warned)]

    same = (
        "'blue sphere' has exactly the Gaussians of 'blue ball', which exists already, so no second object was stored."
    )
    assert ask("blue ball", "blue sphere") == (["blue-ball", "blue-ball"], [same])
    assert ask("blue sphere") == (["blue-ball"], [same])
    assert [record.name for record in list_objects(project.path)] == ["blue ball"]
    # Once the user changed the object, it is another one.
    rename = load_object(project.path, "blue-ball")
    changed = load_membership(project.path, "blue-ball")
    changed[np.argmax(changed)] = 0
    save_object(project.path, replace(rename, n_gaussians=int((changed >= 0.5).sum()), levels=()), changed)
    assert ask("blue sphere") == (["blue-sphere"], [])


def test_object_is_found_again_wherever_the_threshold_of_new_objects_starts(
    blobs: BlobScene, project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    asking = segmenter_of(project, blobs, SMALL)
    asking.segment_texts(["blue ball"], None)
    membership = load_membership(project.path, "blue-ball")
    lower = float(np.sort(membership[membership < 0.5])[-1])
    monkeypatch.setattr("engine.objects.segmenter.DEFAULT_THRESHOLD", lower)
    asking.segment_texts(["blue ball"], "lower")
    assert load_object(project.path, "lower").n_gaussians > load_object(project.path, "blue-ball").n_gaussians
    records, _ = asking.segment_texts(["blue ball"], "again")
    assert [record.name for record in records] == ["lower"]


def test_corrected_object_is_found_again_by_its_word_in_capitals(blobs: BlobScene, project: ProjectFolder) -> None:
    class Any(FakeDetector):
        def check_prompt(self, prompt):  # type: ignore[no-untyped-def]
            return super().check_prompt(prompt.lower())

        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return super().score_descriptions(described, prompt.lower())

    events: list[Event] = []
    asking = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Any(blobs), emit=events.append)
    asking.segment_texts(["blue ball"], None)
    asking.refine("blue ball", [point(blobs, RED, "view_1.png")], [])
    corrected = load_object(project.path, "blue-ball")
    records, _ = asking.segment_texts(["Blue ball"], None)
    assert [one.id for one in records] == ["blue-ball"] == [one.id for one in list_objects(project.path)]
    assert load_object(project.path, "blue-ball") == corrected
    told = [event.message for event in events if isinstance(event, Warned)]
    changed = "'Blue ball' is 'blue ball', which was changed since it was isolated, so no second object was stored."
    assert told == [changed]


def test_misspelt_name_of_a_stored_object_names_it(blobs: BlobScene, project: ProjectFolder) -> None:
    segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], "Portland amphora")
    with pytest.raises(PromptError, match=r"The scene has an object that is called 'Portland amphora'\."):
        segmenter_of(project, blobs, SMALL).segment_texts(["portland anphora"], None)
    with pytest.raises(PromptError) as caught:
        segmenter_of(project, blobs, SMALL).segment_texts(["astrolabe"], None)
    assert "is called" not in str(caught.value)


def test_texts_are_stored_one_after_the_other_and_those_found_before_are_skipped(
    blobs: BlobScene, project: ProjectFolder
) -> None:
    names = {"red ball": "red", "ghost": "ghost", "blue ball": "blue"}
    sequence = segmenter_of(project, blobs, SMALL).segment_each_text(names, skip={"red ball"})
    first = next(sequence)
    assert first.text == "ghost" and first.records == () and "was not found" in first.refusal
    assert list_objects(project.path) == []
    second = next(sequence)
    assert second.text == "blue ball" and not second.refusal
    assert [record.name for record in second.records] == ["blue"]
    assert [record.name for record in list_objects(project.path)] == ["blue"]
    assert list(sequence) == []


@pytest.mark.parametrize(("text", "said"), [("ghost", "'ghost' was not found"), ("astrolabe", "is not known")])
def test_text_that_is_unknown_or_like_nothing_is_answered_by_the_likeliest_objects(
    text: str, said: str, blobs: BlobScene, project: ProjectFolder
) -> None:
    with pytest.raises(PromptError, match=said):
        segmenter_of(project, blobs, SMALL).segment_texts([text], None)
    assert list_objects(project.path) == []
    known = stored(project)
    assert [entry["text"] for entry in known["refused"]] == [text]  # type: ignore[attr-defined]
    shown = parts_shown(blobs, known["candidates"])  # type: ignore[arg-type]
    assert {RED, TWIN, BLUE} <= set(shown) and len(shown) <= 8
    assert {entry["score"] for entry in known["candidates"]} == {0}  # type: ignore[attr-defined]


def test_misspelt_text_is_answered_at_once_and_by_pictures_only_where_the_scene_was_looked_at(
    blobs: BlobScene, project: ProjectFolder
) -> None:
    class Misspelt(FakeDetector):
        def check_prompt(self, prompt: str) -> PromptCheck:
            return PromptCheck(False, [("ball", 1.0)], f"{prompt!r} is not known.", misspelt=True)

    def ask() -> Any:
        with pytest.raises(PromptError, match="is not known"):
            segmenter_of(project, blobs, SMALL, detector_factory=lambda: Misspelt(blobs)).segment_texts(["bal"], None)
        return stored(project)["candidates"]

    shutil.rmtree(project.path / "groups")
    assert ask() == [] and not (project.path / "groups").exists()
    segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], None)
    assert {RED, TWIN, BLUE} <= set(parts_shown(blobs, ask())), "the word may be right, and none of the vocabulary's"


def parts_shown(blobs: BlobScene, candidates: list[dict[str, Any]]) -> list[int]:
    """Return the true part at the place of each candidate, which lies in its box, after looking at its picture."""
    parts = []
    for entry in candidates:
        x, y, (x0, y0, x1, y1) = entry["x"], entry["y"], entry["box"]
        assert x0 < x < x1 and y0 < y < y1
        parts.append(int(blobs.labels[entry["photo"]][int(y), int(x)]))
    return parts


class Unsure(FakeDetector):
    """Finds the right thing, but scores it low from all sides."""

    def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
        return [0.05 * score for score in super().score_descriptions(described, prompt)]


def refuse(blobs: BlobScene, project: ProjectFolder) -> list[dict[str, Any]]:
    with pytest.raises(PromptError, match="looks enough like"):
        segmenter_of(project, blobs, SMALL, detector_factory=lambda: Unsure(blobs)).segment_texts(["red ball"], None)
    candidates: list[dict[str, Any]] = json.loads((project.path / CANDIDATES).read_text())["candidates"]
    return candidates


def test_refused_text_leaves_ranked_candidates_to_click_on(blobs: BlobScene, project: ProjectFolder) -> None:
    candidates = refuse(blobs, project)
    assert list_objects(project.path) == []
    assert [entry["number"] for entry in candidates] == list(range(1, 1 + len(candidates)))
    scores = [entry["score"] for entry in candidates]
    assert scores == sorted(scores, reverse=True) and 0 < scores[0] < SMALL.least_score
    parts = parts_shown(blobs, candidates)
    assert set(parts[:2]) == {RED, TWIN} and len(set(parts)) == len(parts), "each object once, the likeliest first"
    for entry in candidates:
        with Image.open(project.path / entry["picture"]) as picture:
            assert picture.mode == "RGB" and max(picture.size) <= 256


def test_accepted_candidate_becomes_an_object(blobs: BlobScene, project: ProjectFolder) -> None:
    refuse(blobs, project)
    unsure = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Unsure(blobs))
    (record,) = unsure.accept_candidate(2, None)
    assert record.name == "red ball" and record.prompt["accepted"] is True
    assert max(mask_iou(members(project, record.id), blobs.part == part) for part in (RED, TWIN)) > 0.95
    with pytest.raises(PromptError, match=r"no candidate 9\. Known: 1 \(red ball\), 2 \(red ball\)"):
        load_candidate(project.path, 9)


def test_word_that_another_one_excludes_asks_back(blobs: BlobScene, project: ProjectFolder) -> None:
    class Knowing(FakeDetector):
        def check_prompt(self, prompt: str) -> PromptCheck:
            return PromptCheck(True, [], "")

        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return super().score_descriptions(described, "blue ball" if prompt == "bell" else prompt)

        def fitting_word(self, described, prompt):  # type: ignore[no-untyped-def]
            return "blue ball" if prompt == "bell" else ""

    asking = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Knowing(blobs))
    with pytest.raises(PromptError, match="What looks most like 'bell' looks more like 'blue ball'. Ask for that"):
        asking.segment_texts(["bell"], None)
    (refusal,) = stored(project)["refused"]  # type: ignore[misc]
    assert refusal["suggestions"] == ["blue ball"] and list_objects(project.path) == []
    assert parts_shown(blobs, stored(project)["candidates"])[0] == BLUE  # type: ignore[arg-type]
    assert len(asking.segment_texts(["blue ball"], None)[0]) == 1


def test_accepting_loads_no_model(blobs: BlobScene, project: ProjectFolder) -> None:
    def none() -> Any:
        raise AssertionError("a model was loaded")

    refuse(blobs, project)
    segmenter = segmenter_of(project, blobs, SMALL, detector_factory=none, sam_factory=none)
    (record,) = segmenter.accept_candidate(1, "Kugel")
    assert record.name == "Kugel" and record.prompt["detector"] == "fake" and len(record.levels) != 1


def test_accepting_is_not_slowed_down_by_what_renders_trains_or_knows_words(
    blobs: BlobScene, project: ProjectFolder
) -> None:
    refuse(blobs, project)
    code = (
        "import sys; from engine.cli.main import main; assert main(sys.argv[1:]) == 0; "
        "assert not {'torch', 'numba', 'onnxruntime', 'sklearn', 'wgpu'} & set(sys.modules)"
    )
    words = ["segment", str(project.path), "--accept", "1"]
    subprocess.run([sys.executable, "-c", code, *words], check=True, cwd=ROOT)
    (record,) = list_objects(project.path)
    assert record.fit > 0.9
    assert max(mask_iou(members(project, record.id), blobs.part == part) for part in (RED, TWIN)) > 0.95


def test_accepting_a_picture_of_a_stored_object_stores_no_second_one(blobs: BlobScene, project: ProjectFolder) -> None:
    (known,) = segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], "Kugel")[0]
    refuse(blobs, project)
    events: list[Event] = []
    numbers = [one["number"] for one in stored(project)["candidates"] if one["object"] == known.id]  # type: ignore[attr-defined]
    (same,) = segmenter_of(project, blobs, SMALL, emit=events.append).accept_candidate(numbers[0], None)
    assert same.id == known.id and [one.id for one in list_objects(project.path)] == [known.id]
    assert [one.message for one in events if isinstance(one, Warned)] == [
        "This is 'Kugel', which exists already, so no second object was stored."
    ]


def test_candidate_of_another_scene_is_not_accepted(blobs: BlobScene, project: ProjectFolder) -> None:
    refuse(blobs, project)
    gaussians = blobs.gaussians
    fewer = {name: value[1:] for name, value in vars(gaussians).items() if isinstance(value, np.ndarray)}
    save_gaussians(project.path / "gaussians", replace(gaussians, **fewer))
    with pytest.raises(PromptError, match="The scene has changed since this candidate was offered"):
        segmenter_of(project, blobs, SMALL).accept_candidate(1, None)
    (project.path / "objects" / "_candidates" / "1.npz").write_bytes(b"damaged")
    with pytest.raises(FormatError, match=r"1\.npz.*Ask for the text again"):
        load_candidate(project.path, 1)


def test_candidates_are_those_of_the_last_texts(blobs: BlobScene, project: ProjectFolder) -> None:
    refuse(blobs, project)
    segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], None)
    with pytest.raises(PromptError, match="no candidates to accept"):
        load_candidate(project.path, 1)
    (project.path / CANDIDATES).write_text("{")
    with pytest.raises(FormatError, match=r"candidates\.json cannot be read"):
        load_candidate(project.path, 1)


def isolate(blobs: BlobScene, project: ProjectFolder, prompt, name: str = "ball", sam: FakeSam | None = None):  # type: ignore[no-untyped-def]
    (record,) = segmenter_of(project, blobs, SMALL, sam_factory=lambda: sam or FakeSam(blobs)).segment(prompt, name)
    return record


@pytest.mark.parametrize("second", ["view_1.png", "view_2.png"])
def test_clicks_on_two_things_make_one_object(blobs: BlobScene, project: ProjectFolder, second: str) -> None:
    first = point(blobs, RED, "view_1.png")
    prompt = ClickPrompt(first.photo, first.x, first.y, (point(blobs, TWIN, second),))
    record = isolate(blobs, project, prompt)
    assert mask_iou(members(project, record.id), np.isin(blobs.part, [RED, TWIN])) > 0.9
    assert [click["photo"] for click in record.prompt["clicks"]] == ["view_1.png", second]


@pytest.mark.parametrize("photo", ["view_1.png", "view_3.png"])
def test_what_a_negative_click_hits_is_removed(blobs: BlobScene, project: ProjectFolder, photo: str) -> None:
    first = point(blobs, RED, "view_1.png")
    unwanted = point(blobs, TWIN, photo)
    prompt = ClickPrompt(first.photo, first.x, first.y, (point(blobs, TWIN, "view_2.png"),), (unwanted,))
    sam = FakeSam(blobs)
    record = isolate(blobs, project, prompt, sam=sam)
    assert mask_iou(members(project, record.id), blobs.part == RED) > 0.9
    assert record.prompt["not"] == [{"photo": photo, "x": unwanted.x, "y": unwanted.y}]
    told = [labels for name, _, labels, _ in sam.asked if name == "view_1.png" and labels is not None]
    assert any(0.0 in labels for labels in told) == (photo == "view_1.png")


def test_box_and_mask_take_negative_clicks_too(blobs: BlobScene, project: ProjectFolder, tmp_path: Path) -> None:
    both = np.isin(blobs.labels["view_4.png"], [RED, BLUE])
    Image.fromarray((both * 255).astype(np.uint8)).save(tmp_path / "mask.png")
    unwanted = (point(blobs, BLUE, "view_4.png"),)
    record = isolate(blobs, project, MaskPrompt("view_4.png", tmp_path / "mask.png", unwanted))
    assert mask_iou(members(project, record.id), blobs.part == RED) > 0.9
    box = box_of(blobs.labels["view_2.png"] == BLUE)
    record = isolate(blobs, project, BoxPrompt("view_2.png", *box, (point(blobs, RED, "view_2.png"),)))
    assert mask_iou(members(project, record.id), blobs.part == BLUE) > 0.9


def test_object_is_corrected_in_place(blobs: BlobScene, project: ProjectFolder) -> None:
    before = isolate(blobs, project, ClickPrompt(*_place(blobs, RED, "view_1.png")))
    dim(project, blobs)
    (with_detail,) = segmenter_of(project, blobs, SMALL).detail(["ball"])
    assert with_detail.detail is not None and with_detail.detail["kept"]
    detailed = load_detailed(project.path, "ball")
    assert detailed is not None
    np.testing.assert_array_equal(detailed.rows, np.flatnonzero(members(project, "ball")))
    added = point(blobs, BLUE, "view_5.png")
    more = segmenter_of(project, blobs, SMALL).refine("ball", [added], [])
    assert mask_iou(members(project, "ball"), np.isin(blobs.part, [RED, BLUE])) > 0.9
    left = load_detailed(project.path, "ball")
    assert left is not None
    # What was added is as in the scene, and what stayed keeps its detail.
    assert set(left.rows) == set(detailed.rows) & set(np.flatnonzero(members(project, "ball")))
    less = segmenter_of(project, blobs, SMALL).refine("ball", [], [point(blobs, RED, "view_6.png")])
    assert mask_iou(members(project, "ball"), blobs.part == BLUE) > 0.9
    rest = load_detailed(project.path, "ball")
    assert rest is None or set(rest.rows) <= set(np.flatnonzero(members(project, "ball")))
    assert [record.id for record in list_objects(project.path)] == ["ball"]
    assert before.created == more.created == less.created
    assert less.n_gaussians == members(project, "ball").sum() and len(less.refined) == 2
    assert less.refined[0] == {"clicks": [{"photo": added.photo, "x": added.x, "y": added.y}], "not": []}
    thrown = [(one.name, one.why) for one in list_trash(project.path)]
    assert sorted(thrown) == [("ball", "corrected"), ("ball", "corrected"), ("ball", "detailed")]
    restore_object(project, "1")
    assert mask_iou(members(project, "ball-2"), blobs.part == RED) > 0.8


def dim(project: ProjectFolder, blobs: BlobScene) -> None:
    """Make the scene of the project darker than its photos, so that detail has something to gain."""
    save_gaussians(project.path / "gaussians", replace(blobs.gaussians, sh=blobs.gaussians.sh - np.float32(0.4)))


def store(project: ProjectFolder, blobs: BlobScene, *parts: int) -> None:
    """Store the parts as objects that are called by their numbers."""
    for part in parts:
        membership = (blobs.part == part).astype(np.float32)
        count = int(membership.sum())
        record = ObjectRecord(str(part), str(part), {"kind": "click"}, 0.5, 0.9, 0.9, count, len(membership))
        save_object(project.path, record, membership)


def test_all_objects_get_detail_by_one_call_and_none_twice(blobs: BlobScene, project: ProjectFolder) -> None:
    store(project, blobs, RED, BLUE)
    dim(project, blobs)
    segmenter_of(project, blobs, SMALL).store_background()
    scene = (project.path / "gaussians" / "scene.ply").read_bytes()
    told: list[Progress] = []
    segmenter = segmenter_of(
        project, blobs, SMALL, emit=lambda event: told.append(event) if isinstance(event, Progress) else None
    )
    records = segmenter.detail()
    assert [record.id for record in records] == [str(RED), str(BLUE)]
    first = [load_detailed(project.path, record.id) for record in records]
    assert all(one is not None for one in first) and load_detailed(project.path, "background") is None
    assert all(load_object(project.path, record.id).detail == record.detail for record in records)
    assert (project.path / "gaussians" / "scene.ply").read_bytes() == scene
    fractions = [event.fraction for event in told if event.message.startswith("Detailing")]
    assert fractions == sorted(fractions) and fractions[-1] > 0.5
    told.clear()
    again = segmenter.detail()
    assert [record.detail for record in again] == [record.detail for record in records]
    assert not any(event.message.startswith("Detailing") for event in told)
    assert [one.why for one in list_trash(project.path)] == ["detailed", "detailed"]


def test_helper_details_its_share_of_the_objects_with_the_same_bits(
    blobs: BlobScene, project: ProjectFolder, tmp_path: Path
) -> None:
    store(project, blobs, RED, BLUE)
    dim(project, blobs)
    alone = shutil.copytree(project.path, tmp_path / "alone")
    (expected, _), helper = segmenter_of(ProjectFolder.open_existing(alone), blobs, SMALL).detail(), HelperHere()
    with helped_by(lambda: helper):
        records = segmenter_of(project, blobs, SMALL).detail()
    assert len(helper.called) == 1
    assert not (project.path / "detail_shares").exists()
    for record in records:
        here, there = load_detailed(project.path, record.id), load_detailed(alone, record.id)
        assert here is not None and there is not None and record.detail is not None
        assert all(
            np.array_equal(getattr(here.gaussians, name), getattr(there.gaussians, name))
            for name in ("means", "log_scales", "quats", "opacity_logits", "sh")
        )
        assert np.array_equal(here.rows, there.rows) and np.array_equal(here.parents, there.parents)
    assert expected.detail is not None and records[0].detail is not None
    assert records[0].detail["psnr"] == expected.detail["psnr"]
    helper.called.clear()
    with helped_by(lambda: helper):
        segmenter_of(project, blobs, SMALL).detail()
    assert not helper.called


def test_stopping_while_the_second_object_gets_detail_keeps_the_first(blobs: BlobScene, project: ProjectFolder) -> None:
    store(project, blobs, RED, BLUE)
    dim(project, blobs)
    stopped: list[bool] = []

    def emit(event: Event) -> None:
        if isinstance(event, Progress) and event.message == f"Detailing {BLUE}":
            stopped.append(True)

    before = (project.path / "objects" / str(BLUE) / "object.json").read_bytes()
    with pytest.raises(Cancelled):
        segmenter_of(project, blobs, SMALL, emit=emit, should_stop=lambda: bool(stopped)).detail()
    assert load_detailed(project.path, str(RED)) is not None
    assert load_detailed(project.path, str(BLUE)) is None
    assert (project.path / "objects" / str(BLUE) / "object.json").read_bytes() == before


def test_what_cannot_get_detail_is_one_sentence(blobs: BlobScene, project: ProjectFolder) -> None:
    with pytest.raises(ObjectError, match="no objects yet"):
        segmenter_of(project, blobs, SMALL).detail()
    store(project, blobs, RED)
    segmenter_of(project, blobs, SMALL).store_background()
    with pytest.raises(ObjectError, match="is the background"):
        segmenter_of(project, blobs, SMALL).detail(["background"])
    with pytest.raises(ObjectError, match="No object is called"):
        segmenter_of(project, blobs, SMALL).detail(["cube"])


def _place(blobs: BlobScene, part: int, photo: str) -> tuple[str, float, float]:
    return photo, *blobs.center_of(part, photo)


def test_correction_that_would_leave_nothing_keeps_the_object(blobs: BlobScene, project: ProjectFolder) -> None:
    isolate(blobs, project, ClickPrompt(*_place(blobs, RED, "view_1.png")))
    before = members(project, "ball")
    everywhere = [point(blobs, RED, f"view_{i}.png") for i in range(8)]
    with pytest.raises(PromptError, match="Nothing would be left of 'ball'"):
        segmenter_of(project, blobs, SMALL).refine("ball", [], everywhere)
    np.testing.assert_array_equal(members(project, "ball"), before)
    with pytest.raises(ObjectError, match="No object is called"):
        segmenter_of(project, blobs, SMALL).refine("cube", [], everywhere)


def test_another_level_is_chosen_and_gets_detail_without_a_model(blobs: BlobScene, project: ProjectFolder) -> None:
    small, large = (blobs.part == RED).astype(np.float32), np.isin(blobs.part, [RED, TWIN]).astype(np.float32)
    counts = tuple({"n_gaussians": int(one.sum())} for one in (small, large))
    record = ObjectRecord(
        "pair", "Pair", {"kind": "click"}, 0.5, 0.9, 0.9, counts[1]["n_gaussians"], len(small), level=1, levels=counts
    )
    save_object(project.path, record, large, levels=[small, large])
    dim(project, blobs)

    def choose(level: int) -> ObjectRecord:
        no_models = {"detector_factory": lambda: pytest.fail("detector"), "sam_factory": lambda: pytest.fail("SAM")}
        return segmenter_of(project, blobs, SMALL, **no_models).choose_level("Pair", level)

    changed = choose(0)
    detailed = load_detailed(project.path, "pair")
    assert detailed is not None
    np.testing.assert_array_equal(detailed.rows, np.flatnonzero(small))
    assert changed.level == 0 and changed.n_gaussians == int(small.sum())
    np.testing.assert_array_equal(load_membership(project.path, "pair"), small)
    np.testing.assert_array_equal(load_levels(project.path, "pair"), [small, large])
    save_gaussians(project.path / "gaussians", blobs.gaussians[:900])
    with pytest.raises(ObjectError, match="earlier training"):
        choose(1)
    save_gaussians(project.path / "gaussians", blobs.gaussians)
    with pytest.raises(ObjectError, match="levels 0 to 1, and no level 2"):
        choose(2)
    refined = segmenter_of(project, blobs, SMALL).refine("Pair", [point(blobs, BLUE, "view_1.png")], [])
    assert refined.levels == () and len(load_levels(project.path, "pair")) == 1
    with pytest.raises(ObjectError, match="only one level"):
        choose(1)


def test_background_is_what_belongs_to_no_object(blobs: BlobScene, project: ProjectFolder) -> None:
    with pytest.raises(ObjectError, match="no objects yet"):
        segmenter_of(project, blobs, SMALL).store_background()
    isolate(blobs, project, ClickPrompt(*_place(blobs, RED, "view_1.png")), "one")
    segmenter_of(project, blobs, SMALL).store_background()
    isolate(blobs, project, ClickPrompt(*_place(blobs, BLUE, "view_1.png")), "two")
    record = segmenter_of(project, blobs, SMALL).store_background()
    assert [other.id for other in list_objects(project.path)] == ["one", "two", "background"]
    assert [entry.name for entry in list_trash(project.path)] == ["background"]
    rest = members(project, record.id)
    np.testing.assert_array_equal(rest, ~(members(project, "one") | members(project, "two")))


def test_forms_of_several_clicks_are_read() -> None:
    prompt = parse_prompt(click=["a.jpg=1,2", "b.jpg=3,4"], excluded=["a.jpg=5,6"])
    assert prompt == ClickPrompt("a.jpg", 1, 2, (Point("b.jpg", 3, 4),), (Point("a.jpg", 5, 6),))
    with pytest.raises(PromptError, match="PHOTO=x,y"):
        parse_prompt(click=["a.jpg=1,2"], excluded=["a.jpg"])


def stored(project: ProjectFolder) -> dict[str, object]:
    return json.loads((project.path / CANDIDATES).read_text())  # type: ignore[no-any-return]


def test_misspelt_text_is_stored_with_what_was_meant(blobs: BlobScene, project: ProjectFolder) -> None:
    class Suggesting(FakeDetector):
        def check_prompt(self, prompt: str) -> PromptCheck:
            return PromptCheck(prompt != "bal", [("ball", 1.0), ("bell", 0.9)], f"{prompt!r} is not known.")

    segmenter = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Suggesting(blobs))
    segmenter.segment(ClickPrompt("view_2.png", *blobs.center_of(RED, "view_2.png")), "left ball")
    with pytest.raises(PromptError, match="not known"):
        segmenter.segment_texts(["left bal"], None)
    (refusal,) = stored(project)["refused"]  # type: ignore[misc]
    assert refusal["suggestions"] == ["left ball", "left bell"] and refusal["objects"] == ["left-ball"]


@pytest.mark.parametrize(("name", "offer"), [("offline-vocabulary", "clip-vit-b-32"), ("clip-vit-b-32", "")])
@pytest.mark.parametrize("text", ["ghost", "xylograph"])
def test_model_for_any_word_is_offered_where_the_vocabulary_does_not_know_or_find_a_word(
    text: str, name: str, offer: str, blobs: BlobScene, project: ProjectFolder
) -> None:
    detector = FakeDetector(blobs)
    detector.name = name
    with pytest.raises(PromptError):
        segmenter_of(project, blobs, SMALL, detector_factory=lambda: detector).segment_texts([text], None)
    (refusal,) = stored(project)["refused"]  # type: ignore[misc]
    assert refusal["text"] == text and refusal["offer"] == offer
    assert read_not_found(project.path).offer == offer


def test_candidate_that_is_a_stored_object_says_so(blobs: BlobScene, project: ProjectFolder) -> None:
    class Unsure(FakeDetector):
        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return [0.05 * score for score in super().score_descriptions(described, prompt)]

    (known,) = segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], None)[0]
    unsure = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Unsure(blobs))
    with pytest.raises(PromptError, match="looks enough like"):
        unsure.segment_texts(["blue ball"], "other")
    assert known.id in [candidate["object"] for candidate in stored(project)["candidates"]]  # type: ignore[attr-defined]


def test_object_with_an_unsure_name_has_a_picture_of_it(
    blobs: BlobScene, project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    sure = 0.9
    monkeypatch.setattr("engine.objects.segmenter.SURE_SCORE", sure)

    class Unsure(FakeDetector):
        factor = 0.999

        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return [self.factor * score for score in super().score_descriptions(described, prompt)]

    for factor, name in ((0.999, "sure"), (0.6, "unsure")):
        Unsure.factor = factor
        (record,) = segmenter_of(project, blobs, SMALL, detector_factory=lambda: Unsure(blobs)).segment_texts(
            ["blue ball"], name
        )[0]
        picture = project.path / "objects" / record.id / "picture.png"
        assert picture.exists() == (record.score < sure) == (name == "unsure"), record.score
        delete_object(project, record.id, why="test")


def test_words_are_answered_from_what_is_stored_where_the_photos_are_gone(
    blobs: BlobScene, project: ProjectFolder
) -> None:
    with_photos = refuse(blobs, project)
    shutil.rmtree(project.path.parent / "photos")
    without = refuse(blobs, project)
    for entry, other in zip(with_photos, without, strict=True):
        assert (entry["photo"], entry["box"], entry["score"]) == (other["photo"], other["box"], other["score"])
        with Image.open(project.path / other["picture"]) as picture:
            red, _, blue = np.asarray(picture, np.float64).reshape(-1, 3).max(axis=0)
        assert max(red, blue) > 100, "the scene is shown in place of the photo"
    (record,) = segmenter_of(project, blobs, SMALL).segment_texts(["blue ball"], None)[0]
    assert mask_iou(members(project, record.id), blobs.part == BLUE) > 0.95
