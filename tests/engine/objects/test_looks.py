from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import Cancelled
from engine.core.events import Event, Progress
from engine.masks import mask_iou
from engine.objects.context import SegmentationContext
from engine.objects.looks import Looks, build_looks, load_or_build_looks
from engine.objects.photos import Photos
from engine.objects.prompts import TextPrompt
from engine.objects.segment import find_objects
from engine.objects.settings import BETTER
from engine.objects.views import Views
from engine.pictures.scene import Scene
from tests.engine.objects.fakes import FakeDetector, FakeSam
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene

SETTINGS = replace(BETTER, photo_side=160, render_side=160)


class CountingDetector(FakeDetector):
    """Counts the crops that it was shown."""

    n_shown = 0

    def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
        self.n_shown += len(masks)
        return super().describe_crops(pixels, boxes, masks)


class BoxDetector(FakeDetector):
    """Describes no crops, but finds boxes, like Grounding DINO."""

    def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
        return None

    def name_descriptions(self, described):  # type: ignore[no-untyped-def]
        return []


@pytest.fixture
def photos(blobs: BlobScene, tmp_path: Path) -> Photos:
    return Photos(blobs.write_photos(tmp_path / "photos"), SETTINGS, lambda: FakeSam(blobs))


def context_of(scene: BlobScene, photos: Photos, detector: FakeDetector, **given: Any) -> SegmentationContext:
    views = Views(Scene(scene.gaussians), scene.cameras, render_side=160)
    return SegmentationContext(views, photos, scene.labels, SETTINGS, lambda: detector, **given)  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize("kind", [FakeDetector, BoxDetector], ids=["describes crops", "finds boxes"])
def test_each_object_is_a_proposal_and_a_text_chooses_those_that_look_like_it(
    kind: type[FakeDetector], blobs: BlobScene, photos: Photos
) -> None:
    context = context_of(blobs, photos, kind(blobs))
    looks = build_looks(context)
    best = {
        part: int(np.argmax([mask_iou(one, blobs.part == part) for one in looks.members])) for part in (RED, TWIN, BLUE)
    }
    assert all(mask_iou(looks.members[k], blobs.part == part) > 0.9 for part, k in best.items())
    assert len(set(best.values())) == 3
    for text, parts in (("blue ball", {BLUE}), ("red ball", {RED, TWIN})):
        scores = looks.scores(text, context)
        assert {part for part, k in best.items() if scores[k] >= 0.5} == parts
    assert looks.scores("ghost", context).max() < 0.5


def test_a_certain_object_is_not_every_word(blobs: BlobScene, photos: Photos) -> None:
    context = context_of(blobs, photos, FakeDetector(blobs))
    looks = build_looks(context)
    certain = replace(looks, odds=np.full_like(looks.odds, 16))
    assert certain.scores("ghost", context).max() < 0.5


def test_evidence_of_a_proposal_is_what_it_consists_of_and_where_a_photo_shows_it(
    blobs: BlobScene, photos: Photos
) -> None:
    context = context_of(blobs, photos, FakeDetector(blobs))
    looks = build_looks(context)
    number = int(np.argmax([mask_iou(one, blobs.part == BLUE) for one in looks.members]))
    item = looks.evidence(number, 0.7, context)
    assert item.score == 0.7 and item.members is not None
    np.testing.assert_array_equal(item.members, looks.members[number])
    assert mask_iou(item.view.to_photo(item.mask), blobs.labels[item.view.camera.photo] == BLUE) > 0.8


def test_proposals_are_described_once_and_stored(blobs: BlobScene, photos: Photos, tmp_path: Path) -> None:
    detector, folder = CountingDetector(blobs), tmp_path / "groups"
    first, again = (load_or_build_looks(context_of(blobs, photos, detector, folder=folder)) for _ in range(2))
    assert detector.n_shown == len(first.proposal) > 0
    assert again.photo == first.photo
    # The first answer is that of later ones, also after a kill between them.
    for name in ("members", "odds", "like", "proposal", "box", "described"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))


@pytest.mark.parametrize(("name", "value"), [("like", 1000), ("like", -1), ("proposal", 1000), ("photo", "no.jpg")])
def test_looks_that_name_what_does_not_exist_are_made_again(
    name: str, value: object, blobs: BlobScene, photos: Photos, tmp_path: Path
) -> None:
    file, detector = tmp_path / "looks.npz", CountingDetector(blobs)
    load_or_build_looks(context_of(blobs, photos, detector, folder=tmp_path))
    shown = detector.n_shown
    with np.load(file) as stored:
        arrays = dict(stored)
    arrays[name] = np.concatenate([np.array([value], arrays[name].dtype), arrays[name][1:]])
    np.savez_compressed(file, **arrays)
    load_or_build_looks(context_of(blobs, photos, detector, folder=tmp_path))
    assert detector.n_shown == 2 * shown


@pytest.mark.parametrize("damage", ["cut short", "another training"])
def test_damaged_or_outdated_looks_are_made_again(
    damage: str, blobs: BlobScene, photos: Photos, tmp_path: Path
) -> None:
    file, detector = tmp_path / "looks.npz", CountingDetector(blobs)
    load_or_build_looks(context_of(blobs, photos, detector, folder=tmp_path))
    shown, scene = detector.n_shown, blobs
    if damage == "cut short":
        file.write_bytes(file.read_bytes()[:-200])
    else:
        moved = replace(blobs.gaussians, means=blobs.gaussians.means + np.float32(1e-3))
        scene = replace(blobs, gaussians=moved)
    load_or_build_looks(context_of(scene, photos, detector, folder=tmp_path))
    assert detector.n_shown > shown


def test_making_looks_can_be_stopped_and_reports_progress(blobs: BlobScene, photos: Photos) -> None:
    detector = FakeDetector(blobs)
    with pytest.raises(Cancelled, match="no object was stored"):
        build_looks(context_of(blobs, photos, detector, should_stop=lambda: True))
    events: list[Event] = []
    build_looks(context_of(blobs, photos, detector, emit=events.append))
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


@pytest.mark.parametrize(
    ("scores", "odds", "expected"),
    [
        ([0.80, 0.77, 0.1], [0, 2, 0], [(BLUE,)]),
        ([0.80, 0.77, 0.1], [2, 0, 0], [(BLUE, RED)]),
        ([0.80, 0.60, 0.1], [0, 2, 0], [(BLUE, RED)]),
        ([0.79, 0.80, 0.8], [9, 0, 0], [(BLUE,), (RED,)]),  # both are answers, so what shows both is none
    ],
)
def test_of_versions_that_score_nearly_as_much_the_likeliest_whole_is_the_answer(
    scores: list[float], odds: list[float], expected: list[tuple[int, ...]], blobs: BlobScene, photos: Photos
) -> None:
    class Scored(Looks):
        def scores(self, text: str, context: SegmentationContext) -> np.ndarray:
            return np.array(scores)

    context = replace(context_of(blobs, photos, FakeDetector(blobs)), settings=replace(SETTINGS, detail_steps=0))
    made, parts = build_looks(context), [(BLUE, RED), (BLUE,), (RED,)]
    members = np.array([np.isin(blobs.part, part) for part in parts])
    sightings = (made.photo[:1] * 3, made.box[[0, 0, 0]], made.described[[0, 0, 0]])
    numbers = np.arange(3, dtype=np.int32)
    context.kept["looks"] = Scored(members, np.array(odds, np.float32), numbers, numbers, *sightings)
    found = find_objects(context, TextPrompt("blue ball"))
    assert len(found) == len(expected)
    for one, part in zip(found, expected, strict=True):
        assert mask_iou(one.members, np.isin(blobs.part, part)) > 0.8
        assert one.score == max(scores)


class Unfitted(FakeDetector):
    """Draws scores of crops at random: those of 999 words of a vocabulary, and of absent ones; one word is shown."""

    def __init__(self, scale: float) -> None:
        self.scale, self.name = scale, f"random {scale}"

    def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
        random = np.random.default_rng(sum(map(ord, prompt)) if prompt == "shown" else int(prompt))
        scores = random.beta(0.2, 6, len(described)) ** self.scale
        if prompt == "shown":
            scores[:3] = 0.7**self.scale
        return scores.tolist()

    def score_vocabulary(self, described):  # type: ignore[no-untyped-def]
        return np.stack([self.score_descriptions(described, str(10_000 + k)) for k in range(999)], axis=1)


def _random_looks() -> Looks:
    random = np.random.default_rng(0)
    proposal = np.repeat(np.arange(40, dtype=np.int32), 3)
    return Looks(
        random.random((40, 50)) > 0.5, random.normal(size=40).astype(np.float32), np.arange(40, dtype=np.int32),
        proposal, ("a",) * 120, np.zeros((120, 2, 2), np.float32), np.zeros((120, 4), np.float32),
    )  # fmt: skip


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_absent_words_are_refused_by_the_words_of_a_vocabulary_whatever_the_scores_of_a_detector_mean(
    scale: float,
) -> None:
    looks, detector = _random_looks(), Unfitted(scale)
    accepted = [float(looks.described_scores(str(number), detector).max()) >= 0.5 for number in range(10_000, 10_999)]
    assert sum(accepted) == 39  # of 999 words of the vocabulary: less than 4 %, by construction
    others = [float(looks.described_scores(str(number), detector).max()) >= 0.5 for number in range(400)]
    assert np.mean(others) < 0.07  # 4 % of 400 words, and three standard deviations
    scores = looks.described_scores("shown", detector)
    assert scores.argmax() == 0 and scores[0] > 0.5


def test_a_vocabulary_of_few_words_accepts_nothing(blobs: BlobScene) -> None:
    class Few(Unfitted):
        def score_vocabulary(self, described):  # type: ignore[no-untyped-def]
            return super().score_vocabulary(described)[:, :23]

    assert _random_looks().described_scores("shown", Few(1.0)).max() == 0


class Axes:
    """Scores a description for each word by its value at the word's axis."""

    def score_examples(self, described, means):  # type: ignore[no-untyped-def]
        return described @ means.T


def _axis_scores(described: list[list[float]], n_others: int) -> np.ndarray:
    """Return the scores of two proposals for axis 0, beside that many words on axis 1."""
    rows = np.array(described, np.float32)
    count = len(rows)
    looks = Looks(
        np.eye(count, dtype=bool), np.zeros(count, np.float32), np.arange(count, dtype=np.int32),
        np.arange(count, dtype=np.int32), ("a",) * count, np.zeros((count, 2, 2), np.float32), rows,
    )  # fmt: skip
    others = np.tile(np.array([[0, 1]], np.float32), (n_others, 1))
    return looks.scores_of_examples(np.array([[1, 0]], np.float32), others, Axes())  # type: ignore[arg-type]


def test_what_looks_more_like_another_taught_word_is_that() -> None:
    described = [[0.7, 0.9], [0.6, 0.01]]
    alone, beside = _axis_scores(described, 0), _axis_scores(described, 1)
    assert alone[0] > alone[1] and beside[0] < 0.5 * alone[0]
    assert beside[1] > alone[1], "what is no other word either becomes surer"


def test_what_the_vocabulary_knows_of_a_taught_word_moves_its_scores() -> None:
    class Knowing(Axes):
        name = "knowing"

        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return [0.9, 0.001]

        def score_vocabulary(self, described):  # type: ignore[no-untyped-def]
            return np.full((len(described), 99), 0.3)

    count, rows = 2, np.array([[0.6, 0.01], [0.6, 0.01]], np.float32)
    looks = Looks(
        np.eye(count, dtype=bool), np.zeros(count, np.float32), np.arange(count, dtype=np.int32),
        np.arange(count, dtype=np.int32), ("a",) * count, np.zeros((count, 2, 2), np.float32), rows,
    )  # fmt: skip
    taught, others = np.array([[1, 0]], np.float32), np.zeros((0, 2), np.float32)
    alone = looks.scores_of_examples(taught, others, Knowing())  # type: ignore[arg-type]
    known = looks.scores_of_examples(taught, others, Knowing(), "vase")  # type: ignore[arg-type]
    assert known[0] > alone[0] == alone[1] > known[1] > 0


def test_each_further_word_makes_the_others_surer() -> None:
    few, many = (_axis_scores([[0.6, 0.01]], count)[0] for count in (1, 40))
    assert few < many


def test_proposal_that_no_photo_shows_is_no_taught_word() -> None:
    looks = Looks(
        np.eye(2, dtype=bool), np.zeros(2, np.float32), np.arange(2, dtype=np.int32), np.zeros(1, np.int32), ("a",),
        np.zeros((1, 2, 2), np.float32), np.array([[0.8, 0.9]], np.float32),
    )  # fmt: skip
    scores = looks.scores_of_examples(np.array([[1, 0]], np.float32), np.array([[0, 1]], np.float32), Axes())  # type: ignore[arg-type]
    assert scores[1] == 0 and np.isfinite(scores).all()
