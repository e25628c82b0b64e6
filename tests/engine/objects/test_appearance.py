from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.errors import Cancelled
from engine.events import Event, Progress, ignore_events, never_stop
from engine.objects.appearance import GroupAppearance, describe_groups, load_or_describe_groups
from engine.objects.evidence import evidence_of_groups
from engine.objects.photos import Photos
from engine.objects.views import Views
from engine.pictures.scene import Scene
from tests.engine.objects.fakes import FakeDetector, FakeSam
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


class CountingDetector(FakeDetector):
    """Counts the crops that it was shown."""

    n_shown = 0

    def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
        self.n_shown += len(masks)
        return super().describe_crops(pixels, boxes, masks)


class SilentDetector(FakeDetector):
    """Does not describe crops."""

    def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
        return None


@pytest.fixture
def views(blobs: BlobScene) -> Views:
    return Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)


@pytest.fixture
def photos(blobs: BlobScene, tmp_path: Path) -> Photos:
    return Photos(blobs.write_photos(tmp_path / "photos"), 160, lambda: FakeSam(blobs))


def appearance_of(views: Views, photos: Photos, detector: FakeDetector) -> GroupAppearance:
    appearance = describe_groups(views, photos, detector, emit=ignore_events, should_stop=never_stop)
    assert appearance is not None
    return appearance


def members_iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def test_a_text_points_to_the_group_that_looks_like_it(blobs: BlobScene, views: Views, photos: Photos) -> None:
    detector = FakeDetector(blobs)
    best = evidence_of_groups("blue ball", appearance_of(views, photos, detector), views, detector, 4)[0]
    assert best.members is not None and members_iou(best.members, blobs.part == BLUE) > 0.95
    assert best.score > 0.8
    truth = blobs.labels[best.view.camera.photo] == BLUE
    assert members_iou(best.view.to_photo(best.mask), truth) > 0.8


def test_equal_objects_are_both_found(blobs: BlobScene, views: Views, photos: Photos) -> None:
    detector = FakeDetector(blobs)
    evidence = evidence_of_groups("red ball", appearance_of(views, photos, detector), views, detector, 4)
    for part in (RED, TWIN):
        assert (
            max(members_iou(item.members, blobs.part == part) for item in evidence if item.members is not None) > 0.95
        )


def test_text_that_no_group_looks_like_has_no_evidence(blobs: BlobScene, views: Views, photos: Photos) -> None:
    detector = FakeDetector(blobs)
    assert evidence_of_groups("ghost", appearance_of(views, photos, detector), views, detector, 4) == []


def test_appearance_is_described_once_and_stored(
    blobs: BlobScene, views: Views, photos: Photos, tmp_path: Path
) -> None:
    file, detector = tmp_path / "groups" / "looks.npz", CountingDetector(blobs)
    given = {"emit": ignore_events, "should_stop": never_stop}
    made = load_or_describe_groups(file, views, photos, detector, **given)  # type: ignore[arg-type]
    shown = detector.n_shown
    again = load_or_describe_groups(file, views, photos, detector, **given)  # type: ignore[arg-type]
    assert shown > 0 and detector.n_shown == shown
    assert made is not None and again is not None
    assert again.photo == made.photo and np.array_equal(again.group, made.group)
    np.testing.assert_allclose(again.described, made.described, atol=1e-3)
    for photo, group_map in made.group_maps.items():
        assert np.array_equal(again.group_maps[photo], group_map)


@pytest.mark.parametrize("damage", ["cut short", "another training"])
def test_damaged_or_outdated_appearance_is_described_again(
    damage: str, blobs: BlobScene, views: Views, photos: Photos, tmp_path: Path
) -> None:
    file, detector = tmp_path / "looks.npz", CountingDetector(blobs)
    given = {"emit": ignore_events, "should_stop": never_stop}
    load_or_describe_groups(file, views, photos, detector, **given)  # type: ignore[arg-type]
    shown = detector.n_shown
    if damage == "cut short":
        file.write_bytes(file.read_bytes()[:-200])
    else:
        moved = replace(blobs.gaussians, means=blobs.gaussians.means + np.float32(1e-3))
        views = Views(Scene(moved), blobs.cameras, render_side=160)
    assert load_or_describe_groups(file, views, photos, detector, **given) is not None  # type: ignore[arg-type]
    assert detector.n_shown > shown


def test_detector_that_does_not_describe_crops_gives_no_appearance(
    blobs: BlobScene, views: Views, photos: Photos, tmp_path: Path
) -> None:
    file = tmp_path / "looks.npz"
    given = {"emit": ignore_events, "should_stop": never_stop}
    assert load_or_describe_groups(file, views, photos, SilentDetector(blobs), **given) is None  # type: ignore[arg-type]
    assert not file.exists()


def test_describing_can_be_stopped_and_reports_progress(blobs: BlobScene, views: Views, photos: Photos) -> None:
    with pytest.raises(Cancelled, match="no object was stored"):
        describe_groups(views, photos, FakeDetector(blobs), emit=ignore_events, should_stop=lambda: True)
    events: list[Event] = []
    describe_groups(views, photos, FakeDetector(blobs), emit=events.append, should_stop=never_stop)
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
