from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, MaskError, ObjectError, PromptError
from engine.core.events import Event, Progress, ignore_events, never_stop
from engine.masks import mask_iou
from engine.objects.context import SegmentationContext
from engine.objects.found import FoundObject
from engine.objects.lifting import isolate_object
from engine.objects.looks import Looks
from engine.objects.photos import Photos
from engine.objects.prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, Prompt, TextPrompt
from engine.objects.segment import NoMatchError, find_objects
from engine.objects.settings import BETTER, PAPER, SegmentSettings
from engine.objects.views import Views
from engine.objects.votes import MaskEvidence, Votes, count_votes
from engine.pictures.render import render_view
from engine.pictures.scene import Scene
from engine.project.objects import list_objects, load_membership
from tests.engine.install.models.weights import fetched
from tests.engine.objects.fakes import FakeDetector, FakeSam, box_of, segmenter_of, trained_project
from tests.engine.pictures.blob_scene import BLUE, FLOOR, RED, TWIN, BlobScene, as_pinhole, make_scene

SMALL = replace(PAPER, photo_side=160, render_side=160, erode_pixels=1)
SMALL_BETTER = replace(BETTER, photo_side=160, render_side=160, detail_steps=3)


def not_needed() -> object:
    raise AssertionError("this prompt needs no such model")


@pytest.fixture
def find(blobs: BlobScene, tmp_path: Path) -> Callable[..., list[FoundObject]]:
    """``find(prompt, settings=SMALL, scene=blobs, ...)`` with the fakes."""

    def ask(
        prompt: Prompt, *, settings: SegmentSettings = SMALL, scene: BlobScene = blobs, **given: object
    ) -> list[FoundObject]:
        sam_factory = given.pop("sam_factory", lambda: FakeSam(scene))
        context = SegmentationContext(
            Views(Scene(scene.gaussians), scene.cameras, render_side=settings.render_side),
            Photos(scene.write_photos(tmp_path / "photos"), settings, sam_factory),  # type: ignore[arg-type]
            given.pop("label_maps", {}),  # type: ignore[arg-type]
            settings,
            **{"detector_factory": lambda: FakeDetector(scene), **given},  # type: ignore[arg-type]
        )
        return find_objects(context, prompt)

    return ask


def overlap(found: FoundObject, scene: BlobScene, part: int) -> float:
    members, truth = found.membership >= 0.5, scene.part == part
    return mask_iou(members, truth)


@pytest.mark.parametrize("settings", [SMALL, SMALL_BETTER], ids=["paper", "better"])
@pytest.mark.parametrize("part", [RED, TWIN, BLUE])
def test_click_isolates_the_object_under_it(find, blobs: BlobScene, settings: SegmentSettings, part: int) -> None:
    x, y = blobs.center_of(part, "view_1.png")
    (found,) = find(ClickPrompt("view_1.png", x, y), settings=settings)
    assert overlap(found, blobs, part) > 0.95
    assert found.fit > 0.9 and found.score == pytest.approx(0.9 if settings is SMALL else 1.0)


@pytest.mark.parametrize("seed", [11, 12])
def test_click_works_on_other_scenes_too(find, seed: int) -> None:
    scene = make_scene(seed=seed)
    x, y = scene.center_of(BLUE, "view_5.png")
    (found,) = find(ClickPrompt("view_5.png", x, y), scene=scene)
    assert overlap(found, scene, BLUE) > 0.95


def test_click_finds_the_ball_that_its_own_photo_shows_in_one_segment_with_the_floor(find) -> None:
    whole = make_scene()
    blue, floor = np.flatnonzero(whole.part == BLUE), np.flatnonzero(whole.part == FLOOR)
    # By features, the ball is floor, too: only the segments of the other photos show it alone.
    features = whole.gaussians.features.copy()
    features[blue] = features[floor[np.arange(len(blue)) % len(floor)]]
    scene = replace(whole, gaussians=replace(whole.gaussians, features=features))
    labels = scene.labels["view_1.png"]
    maps = {**scene.labels, "view_1.png": np.where(labels == BLUE, FLOOR, labels)}
    x, y = scene.center_of(BLUE, "view_1.png")
    (found,) = find(ClickPrompt("view_1.png", x, y), scene=scene, settings=SMALL_BETTER, label_maps=maps)
    assert overlap(found, scene, BLUE) > 0.75


def test_click_on_a_part_means_the_object_of_the_scene_without_what_is_excluded(find) -> None:
    whole = make_scene()
    blue, floor = np.flatnonzero(whole.part == BLUE), np.flatnonzero(whole.part == FLOOR)
    # By features and by the segments of all photos, the upper half of the ball is a thing of its own.
    upper = blue[whole.gaussians.means[blue, 2] > np.median(whole.gaussians.means[blue, 2])]
    features = whole.gaussians.features.copy()
    features[upper] = -features[floor[0]]
    scene = replace(whole, gaussians=replace(whole.gaussians, features=features))
    maps = {photo: _with_two_halves(labels) for photo, labels in scene.labels.items()}

    def middle(label: int) -> tuple[float, float]:
        rows, columns = np.nonzero(maps["view_1.png"] == label)
        return float(np.median(columns)), float(np.median(rows))

    given = {"scene": scene, "settings": SMALL_BETTER, "label_maps": maps}
    given["sam_factory"] = lambda: FakeSam(replace(scene, labels=maps))
    click, objects = ("view_1.png", *middle(_UPPER)), {"objects": (whole.part == BLUE)[None]}
    (found,) = find(ClickPrompt(*click), kept=dict(objects), **given)
    assert overlap(found, scene, BLUE) > 0.9
    lower = Point("view_1.png", *middle(BLUE))
    for prompt, known in [
        (ClickPrompt(*click), {"objects": objects["objects"][:0]}),
        (ClickPrompt(*click, excluded=(lower,)), objects),
    ]:
        (found,) = find(prompt, kept=dict(known), **given)
        assert overlap(found, scene, BLUE) < 0.75


_UPPER = 99
"""Label of the upper half of the blue ball."""


def _with_two_halves(labels: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(labels == BLUE)
    upper = rows < np.median(rows)
    changed = labels.copy()
    changed[rows[upper], columns[upper]] = _UPPER
    return changed


@pytest.mark.parametrize("parts", [(BLUE, RED), (RED, TWIN)])
def test_two_clicks_in_one_photo_are_one_object_of_both(find, blobs: BlobScene, parts: tuple[int, int]) -> None:
    clicks = tuple(Point("view_1.png", *blobs.center_of(part, "view_1.png")) for part in parts)
    prompt = ClickPrompt(clicks[0].photo, clicks[0].x, clicks[0].y, clicks[1:])
    (found,) = find(prompt, settings=SMALL_BETTER, label_maps=blobs.labels)
    assert all(found.members[blobs.part == part].mean() > 0.9 for part in parts)


def test_box_isolates_the_object_in_it(find, blobs: BlobScene) -> None:
    box = box_of(blobs.labels["view_2.png"] == BLUE)
    (found,) = find(BoxPrompt("view_2.png", *box), detector_factory=not_needed)
    assert overlap(found, blobs, BLUE) > 0.95


def test_box_means_the_object_of_the_scene_that_fills_it_whatever_sam_shows_there(find, blobs: BlobScene) -> None:
    truth = blobs.labels["view_2.png"]
    # SAM takes the ball for a part of the floor.
    mistaken = {**blobs.labels, "view_2.png": np.where(truth == BLUE, FLOOR, truth)}
    given = {
        "settings": SMALL_BETTER,
        "label_maps": blobs.labels,
        "sam_factory": lambda: FakeSam(replace(blobs, labels=mistaken)),
    }
    (found,) = find(BoxPrompt("view_2.png", *box_of(truth == BLUE)), **given)
    assert overlap(found, blobs, BLUE) > 0.9
    # Half of the box is filled: SAM answers.
    x0, y0, x1, y1 = box_of(truth == BLUE)
    (found,) = find(BoxPrompt("view_2.png", x0, y0, x1, y1 + (y1 - y0)), **given)
    assert overlap(found, blobs, BLUE) < 0.5


def test_given_mask_needs_no_model(find, blobs: BlobScene, tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    Image.fromarray(((blobs.labels["view_4.png"] == BLUE) * 255).astype(np.uint8)).save(mask)
    for settings in (SMALL, SMALL_BETTER):
        (found,) = find(
            MaskPrompt("view_4.png", mask), settings=settings, sam_factory=not_needed, detector_factory=not_needed
        )
        assert overlap(found, blobs, BLUE) > 0.95 and found.score == 1.0


def test_given_mask_keeps_a_part_with_the_feature_of_its_support(find, tmp_path: Path) -> None:
    whole = make_scene()
    # The lower and larger part of the blue ball has the feature of the floor: by features alone it is floor.
    low = (whole.part == BLUE) & (whole.gaussians.means[:, 2] < 0.08)
    features = whole.gaussians.features.copy()
    features[low] = features[whole.part == FLOOR][: low.sum()]
    scene = replace(whole, gaussians=replace(whole.gaussians, features=features))
    # SAM sees that part as a segment of its own, like the foot of a goblet.
    segments = {
        camera.photo: np.where(
            (render_view(scene.gaussians, camera, what="mask", members=low) > 0) & (scene.labels[camera.photo] == BLUE),
            np.int32(9), scene.labels[camera.photo],
        )
        for camera in scene.cameras.cameras
    }  # fmt: skip
    mask = tmp_path / "mask.png"
    Image.fromarray(((scene.labels["view_4.png"] == BLUE) * 255).astype(np.uint8)).save(mask)
    (found,) = find(MaskPrompt("view_4.png", mask), settings=SMALL_BETTER, scene=scene, label_maps=segments)
    assert overlap(found, scene, BLUE) > 0.75


def test_given_mask_leaves_out_what_is_visible_beside_it(find, tmp_path: Path) -> None:
    whole = make_scene()
    features = whole.gaussians.features.copy()
    blue, floor = np.flatnonzero(whole.part == BLUE), np.flatnonzero(whole.part == FLOOR)
    features[blue] = features[floor[np.arange(len(blue)) % len(floor)]]
    scene = replace(whole, gaussians=replace(whole.gaussians, features=features))
    # SAM sees the ball and the floor below it as one segment, too.
    segments = {photo: np.where(labels == BLUE, FLOOR, labels) for photo, labels in scene.labels.items()}
    mask = tmp_path / "mask.png"
    Image.fromarray(((scene.labels["view_4.png"] == BLUE) * 255).astype(np.uint8)).save(mask)
    (found,) = find(MaskPrompt("view_4.png", mask), settings=SMALL_BETTER, scene=scene, label_maps=segments)
    assert (found.membership >= 0.5)[blue].mean() > 0.6
    # The part of the floor that the ball hides is decided by its neighbours.
    assert (found.membership >= 0.5)[floor].mean() < 0.15


def test_text_gives_each_of_two_equal_objects(find, blobs: BlobScene) -> None:
    found = find(TextPrompt("red ball"))
    assert len(found) == 2
    best = [max((RED, TWIN), key=lambda part, f=f: overlap(f, blobs, part)) for f in found]
    assert sorted(best) == [RED, TWIN]
    assert all(overlap(f, blobs, part) > 0.95 for f, part in zip(found, best, strict=True))


def test_text_uses_existing_segments_instead_of_sam(find, blobs: BlobScene) -> None:
    maps = {photo: blobs.labels[photo] for photo in ("view_1.png", "view_4.png", "view_6.png")}
    (found,) = find(TextPrompt("blue ball"), label_maps=maps, sam_factory=not_needed)
    assert overlap(found, blobs, BLUE) > 0.95
    assert {item.view.camera.photo for item in found.evidence} <= set(maps)


def test_one_confident_mistake_loses_against_views_that_agree(find, blobs: BlobScene) -> None:
    found = find(TextPrompt("blue ball"), detector_factory=lambda: FakeDetector(blobs, wrong=("view_3.png",)))
    assert len(found) == 1 and overlap(found[0], blobs, BLUE) > 0.95


def test_mistake_in_all_photos_is_corrected_by_crops(find, blobs: BlobScene) -> None:
    prompt = TextPrompt("blue ball")
    fooled = {"detector_factory": lambda: FakeDetector(blobs, wrong=tuple(blobs.pixels)), "label_maps": blobs.labels}
    assert overlap(find(prompt, **fooled)[0], blobs, BLUE) < 0.1
    (found,) = find(prompt, settings=SMALL_BETTER, **fooled)
    assert overlap(found, blobs, BLUE) > 0.95


def test_refused_text_reports_what_is_nearest(find, blobs: BlobScene) -> None:
    settings = replace(SMALL_BETTER, least_score=1.0)
    with pytest.raises(NoMatchError, match="looks enough like .blue ball.") as refusal:
        find(TextPrompt("blue ball"), settings=settings, label_maps=blobs.labels)
    nearest = refusal.value.candidates
    members, truth = nearest[0].members, blobs.part == BLUE
    assert mask_iou(members, truth) > 0.9
    assert [one.score for one in nearest] == sorted((one.score for one in nearest), reverse=True)


def test_text_separates_a_ball_from_the_floor_with_its_feature(find) -> None:  # type: ignore[no-untyped-def]
    whole = make_scene()
    features = whole.gaussians.features.copy()
    blue, floor = np.flatnonzero(whole.part == BLUE), np.flatnonzero(whole.part == FLOOR)
    features[blue] = features[floor[np.arange(len(blue)) % len(floor)]]
    scene = replace(whole, gaussians=replace(whole.gaussians, features=features))
    maps = {photo: scene.labels[photo] for photo in ("view_1.png", "view_4.png", "view_6.png")}
    found = find(TextPrompt("blue ball"), settings=SMALL_BETTER, scene=scene, label_maps=maps)
    members = found[0].membership >= 0.5
    assert members[blue].mean() > 0.6 and members[floor].mean() < 0.15


def test_text_that_nothing_looks_like_is_refused(find, blobs: BlobScene) -> None:
    class Unsure(FakeDetector):
        def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
            return [0.01 * score for score in super().score_descriptions(described, prompt)]

    with pytest.raises(PromptError, match=r"looks enough like 'blue ball': the nearest hardly looks like it\. Use"):
        find(
            TextPrompt("blue ball"), settings=SMALL_BETTER, detector_factory=lambda: Unsure(blobs),
            label_maps=blobs.labels,
        )  # fmt: skip


def test_second_word_needs_no_further_crops(blobs: BlobScene, tmp_path: Path) -> None:
    class Counting(FakeDetector):
        asked = 0

        def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
            self.asked += 1
            return super().describe_crops(pixels, boxes, masks)

    project, counting = trained_project(blobs, tmp_path), Counting(blobs)
    given = {"detector_factory": lambda: counting, "sam_factory": not_needed}
    segmenter_of(project, blobs, SMALL_BETTER, **given).segment(TextPrompt("blue ball"), "blue")
    asked = counting.asked
    segmenter_of(project, blobs, SMALL_BETTER, **given).segment(TextPrompt("red ball"), "red")
    assert counting.asked == asked > 0


def test_objects_with_the_same_feature_are_separated_by_position(find, blobs: BlobScene) -> None:
    features = blobs.gaussians.features.copy()
    features[blobs.part == TWIN] = features[blobs.part == RED]
    scene = replace(blobs, gaussians=replace(blobs.gaussians, features=features))
    x, y = scene.center_of(RED, "view_1.png")
    (found,) = find(ClickPrompt("view_1.png", x, y), scene=scene)
    assert overlap(found, scene, RED) > 0.9
    assert len(find(TextPrompt("red ball"), scene=scene)) == 2


def test_segments_correct_the_errors_of_noisy_features(find, blobs: BlobScene) -> None:
    rng = np.random.default_rng(8)
    features = blobs.gaussians.features + 0.3 * rng.normal(size=blobs.gaussians.features.shape)
    scene = replace(blobs, gaussians=replace(blobs.gaussians, features=features.astype(np.float32)))
    x, y = scene.center_of(BLUE, "view_1.png")
    prompt = ClickPrompt("view_1.png", x, y)
    (paper,) = find(prompt, scene=scene)
    (better,) = find(prompt, scene=scene, settings=SMALL_BETTER, label_maps=scene.labels)
    assert overlap(better, scene, BLUE) > overlap(paper, scene, BLUE)


def test_object_of_two_materials_is_found_as_a_whole_from_its_mask(find, blobs: BlobScene, tmp_path: Path) -> None:
    features = blobs.gaussians.features.copy()
    upper = (blobs.part == BLUE) & (blobs.gaussians.means[:, 2] > 0)
    features[upper] = np.roll(features[upper], 1, axis=1)
    scene = replace(blobs, gaussians=replace(blobs.gaussians, features=features))
    mask = tmp_path / "mask.png"
    Image.fromarray(((blobs.labels["view_4.png"] == BLUE) * 255).astype(np.uint8)).save(mask)
    prompt = MaskPrompt("view_4.png", mask)
    (paper,), (better,) = find(prompt, scene=scene), find(prompt, scene=scene, settings=SMALL_BETTER)
    assert overlap(better, scene, BLUE) > 0.9 > overlap(paper, scene, BLUE)


def test_what_photos_take_for_a_part_of_the_object_but_nothing_connects_with_it_is_left_out(blobs: BlobScene) -> None:
    # SAM made one segment of both red balls in every photo, and the asking picture shows only one of them.
    fused = {photo: np.where(labels == TWIN, RED, labels) for photo, labels in blobs.labels.items()}
    views = Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)
    photos = Photos(Path(), SMALL_BETTER, not_needed)  # type: ignore[arg-type]
    context = SegmentationContext(views, photos, fused, SMALL_BETTER, not_needed)  # type: ignore[arg-type]
    shown = blobs.labels["view_1.png"] == RED
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    whole = as_pinhole(blobs.cameras.cameras[1])
    view = views.from_anywhere(
        whole.part(int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1),
    )
    mask = shown[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    evidence = MaskEvidence(view, view.from_photo(mask), 1.0)
    graph, votes = context.graph, count_votes(views, evidence, context.graph.pixels)
    solved = graph.solve(Votes(votes.inside[:, None], votes.outside[:, None]), SMALL_BETTER.strictness)[:, 0] >= 0.5
    assert solved[blobs.part == TWIN].mean() > 0.5, "the solve alone takes the other ball, too"
    found = isolate_object(context, [evidence])
    assert not found.members[blobs.part == TWIN].any() and overlap(found, blobs, RED) > 0.9


@pytest.mark.parametrize("strictness", [0.01, 0.6])
def test_object_of_a_mask_is_the_level_that_fits_the_mask(blobs: BlobScene, strictness: float) -> None:
    # SAM made one segment of both red balls in every photo, and with a strictness as low, the usual level takes both.
    fused = {photo: np.where(labels == TWIN, RED, labels) for photo, labels in blobs.labels.items()}
    settings = replace(SMALL_BETTER, strictness=strictness)
    views = Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)
    photos = Photos(Path(), settings, not_needed)  # type: ignore[arg-type]
    context = SegmentationContext(views, photos, fused, settings, not_needed)  # type: ignore[arg-type]
    view = views.of(blobs.cameras.cameras[1])
    found = isolate_object(context, [MaskEvidence(view, view.from_photo(blobs.labels["view_1.png"] == RED), 1.0)])
    assert overlap(found, blobs, RED) > 0.9
    assert found.levels.memberships[found.levels.chosen] is found.membership


@pytest.mark.parametrize("is_shown", [False, True])
def test_what_carries_an_object_is_left_out_unless_its_mask_shows_it(
    blobs: BlobScene, monkeypatch: pytest.MonkeyPatch, is_shown: bool
) -> None:
    views = Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)
    photos = Photos(Path(), SMALL_BETTER, not_needed)  # type: ignore[arg-type]
    context = SegmentationContext(views, photos, blobs.labels, SMALL_BETTER, not_needed)  # type: ignore[arg-type]
    view = views.of(blobs.cameras.cameras[4])
    mask = view.from_photo(blobs.labels["view_4.png"] == BLUE)
    shown = views.scene.votes(view.frame, mask[..., None].astype(np.float32))[:, 0] > 0
    carrier = (blobs.part == BLUE) & (shown == is_shown)
    monkeypatch.setattr("engine.objects.lifting.standing", lambda members, *_: members & ~carrier)
    found = isolate_object(context, [MaskEvidence(view, mask, 1.0)])
    assert found.members[carrier].mean() > 0.9 if is_shown else not found.members[carrier].any()
    assert found.members[(blobs.part == BLUE) & ~carrier].mean() > 0.9


def test_membership_is_in_0_to_1_and_tightens_monotonically(find, blobs: BlobScene) -> None:
    x, y = blobs.center_of(BLUE, "view_1.png")
    for settings in (SMALL, SMALL_BETTER):
        (found,) = find(ClickPrompt("view_1.png", x, y), settings=settings)
        assert found.membership.dtype == np.float32 and found.membership.shape == (len(blobs.gaussians),)
        assert found.membership.min() >= 0 and found.membership.max() <= 1


def test_text_outside_of_the_vocabulary_names_the_nearest_words(find) -> None:
    with pytest.raises(PromptError, match=r"'astrolabe' is not known\. .*red ball, blue ball.* click"):
        find(TextPrompt("astrolabe"), sam_factory=not_needed)


def test_known_word_without_a_match_reports_how_many_photos_were_searched(find) -> None:
    with pytest.raises(PromptError, match="'ghost' was not found in 8 photos"):
        find(TextPrompt("ghost"), sam_factory=not_needed)


def test_click_into_empty_air_finds_nothing(find) -> None:
    with pytest.raises(PromptError, match="No Gaussian"):
        find(ClickPrompt("view_0.png", 2, 2), settings=replace(SMALL, erode_pixels=0), sam_factory=EmptyAirSam)


class EmptyAirSam:
    """Returns a mask of a few pixels in the corner."""

    def encode(self, pixels: np.ndarray) -> np.ndarray:
        return pixels

    def predict(self, embedding, points, labels, box):  # type: ignore[no-untyped-def]
        from tests.engine.objects.fakes import FakePrediction

        mask = np.zeros(embedding.shape[:2], bool)
        mask[:4, :4] = True
        return FakePrediction(mask, 0.5)


def test_scene_without_features_says_what_to_do(find, blobs: BlobScene) -> None:
    scene = replace(blobs, gaussians=replace(blobs.gaussians, features=None))
    with pytest.raises(ObjectError, match="without segmentation features"):
        find(ClickPrompt("view_0.png", 2, 2), scene=scene)


def test_cancel_stores_nothing(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    with pytest.raises(Cancelled):
        segment(project, TextPrompt("red ball"), "ball", blobs, should_stop=lambda: True)
    assert list_objects(project.path) == []


def segment(project, prompt, name, scene, *, settings=SMALL, emit=ignore_events, should_stop=never_stop):  # type: ignore[no-untyped-def]
    return segmenter_of(project, scene, settings, emit=emit, should_stop=should_stop).segment(prompt, name)


def test_each_match_is_stored_under_its_own_name(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    events: list[Event] = []
    records = segment(project, TextPrompt("red ball"), "Ball / rot", blobs, emit=events.append)
    assert [record.name for record in records] == ["Ball / rot", "Ball / rot-2"]
    assert [record.id for record in records] == ["ball-rot", "ball-rot-2"]
    again = segment(project, TextPrompt("blue ball"), "Ball / rot", blobs)
    assert [record.id for record in again] == ["ball-rot-3"]
    assert [record.id for record in list_objects(project.path)] == ["ball-rot", "ball-rot-2", "ball-rot-3"]
    for record in [*records, *again]:
        membership = load_membership(project.path, record.id)
        assert (membership >= record.threshold).sum() == record.n_gaussians > 0
        assert 0 < record.score <= 1
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_object_found_by_text_says_which_detector_found_it(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    events: list[Event] = []
    segment(project, TextPrompt("blue ball"), "ball", blobs, emit=events.append)
    (record,) = list_objects(project.path)
    assert record.prompt == {"kind": "text", "text": "blue ball", "detector": "fake"}
    assert any("(fake)" in event.message for event in events if isinstance(event, Progress))


def test_mask_of_the_wrong_size_stores_nothing(blobs: BlobScene, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    Image.new("L", (10, 10), 255).save(tmp_path / "mask.png")
    with pytest.raises(MaskError, match="10 x 10"):
        segment(project, MaskPrompt("view_0.png", tmp_path / "mask.png"), "ball", blobs)
    assert list_objects(project.path) == []


def test_votes_use_the_projects_label_maps(blobs: BlobScene, tmp_path: Path) -> None:
    from engine.masks.storage import label_map_path, write_label_map

    project = trained_project(blobs, tmp_path)
    for photo, labels in blobs.labels.items():
        write_label_map(label_map_path(project.path / "masks", photo), labels)
    x, y = blobs.center_of(RED, "view_1.png")
    (record,) = segment(project, ClickPrompt("view_1.png", x, y), "ball", blobs, settings=SMALL_BETTER)
    members = load_membership(project.path, record.id) >= 0.5
    truth = blobs.part == RED
    assert mask_iou(members, truth) > 0.95


def test_unknown_word_is_refused_before_any_crop_is_described(find, blobs: BlobScene) -> None:
    class Describing(FakeDetector):
        def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
            raise AssertionError("described crops for an unknown word")

    with pytest.raises(PromptError, match="'astrolabe' is not known"):
        find(TextPrompt("astrolabe"), settings=SMALL_BETTER, detector_factory=lambda: Describing(blobs))


class _Pictured(FakeDetector):
    """Knows "key" from pictures: the blue ball looks most like it."""

    def score_unknown(self, described, prompt):  # type: ignore[no-untyped-def]
        return self.score_descriptions(described, "blue ball") if prompt == "key" else None


@pytest.mark.parametrize(("text", "offers"), [("key", True), ("red ball on the key", False), ("astrolabe", False)])
def test_refusal_says_that_the_likest_is_offered_where_pictures_taught_the_word_and_something_is_offered(
    text: str, offers: bool, find, blobs: BlobScene
) -> None:
    given = {"settings": SMALL_BETTER, "label_maps": blobs.labels, "detector_factory": lambda: _Pictured(blobs)}
    with pytest.raises(PromptError, match="is not known") as refusal:
        find(TextPrompt(text), **given)
    assert ("those that look most like it come first" in str(refusal.value)) is offers


@pytest.mark.parametrize("text", ["vase", "key", "egg", "flux capacitor"])
def test_scene_without_anything_that_may_be_an_object_refuses_every_word_in_a_sentence(
    text: str, find, blobs: BlobScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    from engine.objects.grounding.offline_vocabulary import OfflineVocabulary

    fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    none, no_box, no_row = np.zeros(0, np.int32), np.zeros((0, 2, 2), np.float32), np.zeros((0, 1), np.float32)
    members = np.zeros((0, len(blobs.gaussians.means)), bool)
    looks = Looks(members, np.zeros(0, np.float32), none, none, (), no_box, no_row)
    monkeypatch.setattr("engine.objects.segment.load_or_build_looks", lambda context: looks)
    with pytest.raises(NoMatchError, match=f"{text!r}") as refusal:
        find(TextPrompt(text), settings=SMALL_BETTER, label_maps=blobs.labels, detector_factory=OfflineVocabulary)
    assert refusal.value.candidates == () and "come first" not in str(refusal.value)


def test_left_and_right_are_those_of_the_asking_photo(find, blobs: BlobScene) -> None:
    for camera in blobs.cameras.cameras[:2]:
        columns = {}
        for part in (RED, TWIN):
            x, _, depth = (
                camera.viewmat[:3, :3] @ blobs.gaussians.means[blobs.part == part].mean(axis=0) + camera.viewmat[:3, 3]
            )
            columns[part] = x / depth
        left, right = sorted(columns, key=lambda part: columns[part])
        for text, part in (("the left red ball", left), ("red ball on the right", right)):
            (found,) = find(TextPrompt(text, camera), settings=SMALL_BETTER, label_maps=blobs.labels)
            assert overlap(found, blobs, part) > 0.9
    assert len(find(TextPrompt("leftmost red ball"), settings=SMALL_BETTER, label_maps=blobs.labels)) == 1


def test_relation_to_something_unknown_is_refused_in_one_sentence(find, blobs: BlobScene) -> None:
    with pytest.raises(PromptError, match="'table' is not known"):
        find(TextPrompt("red ball on the table"), settings=SMALL_BETTER, label_maps=blobs.labels)


def test_object_next_to_another_is_the_nearest_one(find, blobs: BlobScene) -> None:
    center = {part: blobs.gaussians.means[blobs.part == part].mean(axis=0) for part in (RED, TWIN, BLUE)}
    nearest = min((RED, TWIN), key=lambda part: float(np.linalg.norm(center[part] - center[BLUE])))
    (found,) = find(TextPrompt("red ball next to the blue ball"), settings=SMALL_BETTER, label_maps=blobs.labels)
    assert overlap(found, blobs, nearest) > 0.9
