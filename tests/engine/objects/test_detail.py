"""An object with detail is as sharp as its photos, never worse than without, opaque, and ends at its outline."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, EnvironmentProblem, FormatError, ObjectError
from engine.core.events import never_stop
from engine.objects.detail import DetailResult, _max_gaussians, _Scores, _steps, detail_object
from engine.objects.detail_cutter import DetailPhotos
from engine.objects.settings import BETTER
from engine.objects.views import Views, erode_mask
from engine.pictures.scene import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, object_gaussians, save_object
from engine.rasterizer.gpu import Gpu
from engine.scene import Camera, CameraSet, Detailed, Gaussians, load_detailed
from engine.training import DetailPlan
from tests.engine.pictures.blob_scene import HEIGHT, RED, WIDTH, as_pinhole, camera_at, make_scene

SMALL = replace(BETTER, render_side=160, detail_steps=120)
SCALE = 2
"""Size of the photos relative to those of `make_scene`."""
TEST_PHOTO = "view_05.png"


@dataclass(frozen=True)
class Seen:
    """A coarse scene, its members, and photos of the same place whose red ball is patterned."""

    gaussians: Gaussians
    members: np.ndarray
    cameras: CameraSet
    photos: DetailPhotos
    pixels: dict[str, np.ndarray]
    inside: dict[str, np.ndarray]

    @property
    def views(self) -> Views:
        return Views(Scene(self.gaussians), self.cameras, render_side=160)

    def detail(self, **changes: Any) -> DetailResult:
        given = {"should_stop": never_stop, **changes}
        return detail_object(self.views, self.photos, self.members, given.pop("settings", SMALL), **given)

    def camera(self, photo: str) -> Camera:
        return self.cameras.by_photo[photo]

    def alone(self, gaussians: Gaussians, photo: str) -> tuple[np.ndarray, np.ndarray]:
        rendered = Scene(gaussians).render(as_pinhole(self.camera(photo)), color=True)
        return rendered.channels[..., :3], rendered.alpha

    def psnr(self, gaussians: Gaussians, photo: str) -> float:
        inside = self.inside[photo]
        error = self.alone(gaussians, photo)[0][inside] - self.pixels[photo][inside] / 255
        return float(-10 * np.log10(np.square(error).mean()))

    def energy(self, picture: np.ndarray, photo: str) -> float:
        gray = picture.astype(np.float32).mean(axis=2)
        energy = np.square(np.gradient(gray)).sum(axis=0)
        return float(energy[erode_mask(self.inside[photo], 2)].mean())


def patterned(gaussians: Gaussians, part: np.ndarray) -> tuple[Gaussians, np.ndarray]:
    """Return the scene whose red ball is 900 small Gaussians, in dark and light stripes, and its members."""
    rng, ball = np.random.default_rng(5), gaussians[part == RED]
    direction = rng.normal(size=(900, 3))
    # As large as the ball of 150 larger Gaussians appears.
    means = ball.means.mean(axis=0) + 0.35 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    fine = replace(
        ball[rng.integers(len(ball), size=900)],
        means=means.astype(np.float32),
        log_scales=np.full((900, 3), np.log(0.028), np.float32),
        sh=ball.sh[0] + 0.6 * np.sign(np.sin(4 * angle)).astype(np.float32)[:, None, None],
    )
    return gaussians[part != RED].joined(fine), np.r_[np.zeros((part != RED).sum(), bool), np.ones(900, bool)]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    scene, folder = make_scene(), tmp_path_factory.mktemp("photos")
    fine, ball = patterned(scene.gaussians, scene.part)
    cameras, pixels, inside = [], {}, {}
    for number in range(12):
        one = camera_at(0.2 + 2 * np.pi * number / 12, f"view_{number:02}.png")
        lens = tuple(SCALE * value for value in one.params)
        camera = replace(one, width=SCALE * WIDTH, height=SCALE * HEIGHT, params=lens)
        shown = Scene(fine).render(as_pinhole(camera), color=True, channels=ball.astype(np.float32)[:, None])
        pixels[camera.photo] = (np.clip(shown.channels[..., :3], 0, 1) * 255).astype(np.uint8)
        inside[camera.photo] = erode_mask(shown.channels[..., 3] > 0.5, 2)
        Image.fromarray(pixels[camera.photo]).save(folder / camera.photo)
        cameras.append(camera)
    nothing = np.zeros((0, 3), np.float32)
    camera_set = CameraSet(tuple(cameras), (), nothing, nothing.astype(np.uint8), 0.5, np.eye(4), False)
    photos = DetailPhotos(folder, frozenset({TEST_PHOTO}))
    return Seen(scene.gaussians, scene.part == RED, camera_set, photos, pixels, inside)


@pytest.fixture(scope="module")
def detailed(seen: Seen) -> DetailResult:
    return seen.detail(settings=replace(SMALL, detail_steps=300))


def test_object_is_sharper_at_the_photos_own_size_than_in_the_scene(seen: Seen, detailed: DetailResult) -> None:
    assert detailed.detailed is not None
    before, after = seen.gaussians[seen.members], detailed.detailed.gaussians
    # The pattern itself has 1; the ball of one colour shows the light of no pattern.
    photo = seen.energy(seen.pixels[TEST_PHOTO] / 255, TEST_PHOTO)
    energies = [seen.energy(seen.alone(one, TEST_PHOTO)[0], TEST_PHOTO) / photo for one in (before, after)]
    assert energies[0] < 0.2 < 0.4 < energies[1] < 1.5, energies
    assert seen.psnr(after, TEST_PHOTO) > seen.psnr(before, TEST_PHOTO) + 3
    assert detailed.record["kept"] and detailed.record["psnr"][1] > detailed.record["psnr"][0] + 3


def test_new_gaussians_follow_the_row_of_their_parent(seen: Seen, detailed: DetailResult) -> None:
    result = detailed.detailed
    assert result is not None and len(result.gaussians) > seen.members.sum()
    np.testing.assert_array_equal(result.rows, np.flatnonzero(seen.members))
    # The photos show some of the ball's Gaussians less than half, because they reach into the floor.
    assert np.isin(result.parents, result.rows).all() and len(np.unique(result.parents)) > 0.8 * len(result.rows)
    # Each stands near its parent: halves move less than the object is wide.
    parents = seen.gaussians.means[result.parents]
    assert np.median(np.linalg.norm(result.gaussians.means - parents, axis=1)) < 0.1
    rows = np.flatnonzero(seen.members)[::3]
    joined, source = result.with_detail(seen.gaussians[rows], rows)
    np.testing.assert_array_equal(rows[source], result.parents[np.isin(result.parents, rows)])
    np.testing.assert_array_equal(joined.features, seen.gaussians.features[rows[source]])


def test_no_gaussian_is_a_needle_or_leaves_the_object(seen: Seen, detailed: DetailResult) -> None:
    assert detailed.detailed is not None
    after, before = detailed.detailed.gaussians, seen.gaussians[seen.members]
    scales = np.sort(after.scales, axis=1)
    assert (scales[:, 2] <= 4.001 * scales[:, 1]).all()
    # A centre may leave the box of the object by 3 % of its radius.
    assert (after.means >= before.means.min(axis=0) - 0.02).all()
    assert (after.means <= before.means.max(axis=0) + 0.02).all()


def test_scene_stays_as_it_is_and_the_result_repeats_exactly(seen: Seen) -> None:
    before = {name: getattr(seen.gaussians, name).copy() for name in ("means", "log_scales", "opacity_logits", "sh")}
    one, other = (seen.detail(settings=replace(SMALL, detail_steps=30)) for _ in range(2))
    assert one.detailed is not None and other.detailed is not None
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(seen.gaussians, name), values)
        np.testing.assert_array_equal(getattr(one.detailed.gaussians, name), getattr(other.detailed.gaussians, name))


def test_test_photos_decide_and_are_not_trained_on(seen: Seen, detailed: DetailResult, tmp_path: Path) -> None:
    assert detailed.record["validation"] == [TEST_PHOTO] and detailed.record["photos"] == 11
    for photo, pixels in seen.pixels.items():
        Image.fromarray(pixels // 2 if photo == TEST_PHOTO else pixels).save(tmp_path / photo)
    dark, same = (
        replace(seen, photos=replace(seen.photos, folder=folder)).detail(settings=replace(SMALL, detail_steps=60))
        for folder in (tmp_path, seen.photos.folder)
    )
    assert dark.record["psnr"][1] < same.record["psnr"][1] and same.detailed is not None
    if dark.detailed is not None and dark.record["trained"]:
        np.testing.assert_array_equal(dark.detailed.gaussians.sh, same.detailed.gaussians.sh)


def test_training_photos_decide_where_no_test_photo_shows_the_object(seen: Seen) -> None:
    result = replace(seen, photos=replace(seen.photos, held_out=frozenset())).detail(
        settings=replace(SMALL, detail_steps=1)
    )
    assert result.record["photos"] + len(result.record["validation"]) == 12 and result.record["validation"]


def test_detail_that_test_photos_refute_is_not_kept(seen: Seen, tmp_path: Path) -> None:
    """All photos but the one that decides are darker, as of another day, and no brightness is known of them."""
    for photo in seen.pixels:
        shown = np.clip(seen.alone(seen.gaussians, photo)[0], 0, 1) * (1.0 if photo == TEST_PHOTO else 0.6)
        Image.fromarray((shown * 255).astype(np.uint8)).save(tmp_path / photo)
    result = replace(seen, photos=replace(seen.photos, folder=tmp_path)).detail(
        settings=replace(SMALL, detail_steps=60)
    )
    assert result.detailed is None and not result.record["kept"]
    assert "stays as it is in the scene: photos that were left out show no gain" in result.sentence


def test_brightness_of_a_photo_is_not_taken_for_the_objects(seen: Seen, tmp_path: Path) -> None:
    gains = {photo: (0.5 if number % 2 else 1.0,) * 3 for number, photo in enumerate(seen.pixels)}
    for photo, pixels in seen.pixels.items():
        Image.fromarray((pixels * gains[photo][0]).astype(np.uint8)).save(tmp_path / photo)
    dim = replace(seen, photos=DetailPhotos(tmp_path, frozenset({TEST_PHOTO}), gains))
    result = dim.detail()
    assert result.detailed is not None
    assert seen.psnr(result.detailed.gaussians, TEST_PHOTO) > seen.psnr(seen.gaussians[seen.members], TEST_PHOTO) + 2


def test_translucent_object_becomes_opaque_and_loses_its_spike(seen: Seen) -> None:
    gaussians, ball = seen.gaussians, np.flatnonzero(seen.members)
    logits, means, log_scales = gaussians.opacity_logits.copy(), gaussians.means.copy(), gaussians.log_scales.copy()
    logits[ball] = -2.0
    # The floor hides the spike.
    means[ball[0]] = means[ball].mean(axis=0) + (-0.5, 0.0, -0.4)
    log_scales[ball[0]], logits[ball[0]] = np.log([0.2, 0.2, 0.02]), 4.0
    spiked = replace(gaussians, means=means, log_scales=log_scales, opacity_logits=logits)
    result = replace(seen, gaussians=spiked).detail(settings=replace(SMALL, detail_steps=200))
    assert result.detailed is not None
    spike = seen.alone(spiked[ball[:1]], TEST_PHOTO)[1] > 0.5
    outside = spike & (cv2.dilate(seen.inside[TEST_PHOTO].astype(np.uint8), np.ones((15, 15))) == 0)
    before, after = (seen.alone(one, TEST_PHOTO)[1] for one in (spiked[ball], result.detailed.gaussians))
    inside = erode_mask(seen.inside[TEST_PHOTO], 4)
    assert before[inside].mean() < 0.9 < 0.95 < after[inside].mean()
    assert before[outside].mean() > 0.7 > 0.35 > after[outside].mean()


def with_floor(seen: Seen) -> tuple[Seen, np.ndarray]:
    """Return the scene with three wrong members, and these: Gaussians of the floor near the ball."""
    ball = np.flatnonzero(seen.members)
    beside = np.linalg.norm(seen.gaussians.means - seen.gaussians.means[ball].mean(axis=0), axis=1)
    others = np.flatnonzero(~seen.members & (beside > 0.7))  # twice the radius of the ball
    floor = others[np.argsort(beside[others])[:3]]
    return replace(seen, members=seen.members | np.isin(np.arange(len(seen.members)), floor)), floor


def scored(seen: Seen, monkeypatch: pytest.MonkeyPatch, *psnr_and_beyond: tuple[float, float]) -> DetailResult:
    """Return the detail of few steps, as if it had these scores: the object as it is, and what may be kept."""
    scores = iter([_Scores(*one) for one in psnr_and_beyond])
    monkeypatch.setattr("engine.objects.detail._scores", lambda *given, **named: next(scores))
    return seen.detail(settings=replace(SMALL, detail_steps=3))


def test_what_the_photos_show_beside_the_object_is_left_out_of_it(seen: Seen) -> None:
    wrong, floor = with_floor(seen)
    result = wrong.detail(settings=replace(SMALL, detail_steps=60))
    assert result.detailed is not None and 3 <= result.record["left_out"] < 40
    assert result.record["beyond"][1] < result.record["beyond"][0]
    assert not np.isin(floor, result.detailed.parents).any() and np.isin(floor, result.detailed.rows).all()
    rows = np.flatnonzero(wrong.members)
    joined, source = result.detailed.with_detail(seen.gaussians[rows], rows)
    assert len(joined) == len(result.detailed.gaussians) and not np.isin(floor, rows[source]).any()


def test_detail_that_only_reaches_less_far_out_is_kept(seen: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    assert scored(seen, monkeypatch, (20, 0.2), (20, 0.1)).detailed is not None
    assert scored(seen, monkeypatch, (20, 0.2), (20, 0.19), (20, 0.19)).detailed is None
    assert scored(seen, monkeypatch, (20, 0.2), (20.1, 0.3)).detailed is not None
    # Half as much outside outweighs 0.15 dB, a quarter twice as much, and nothing outweighs more than 0.4 dB.
    assert scored(seen, monkeypatch, (20, 0.2), (19.9, 0.1)).detailed is not None
    assert scored(seen, monkeypatch, (20, 0.2), (19.8, 0.1), (19.8, 0.1)).detailed is None
    assert scored(seen, monkeypatch, (20, 0.2), (19.75, 0.05)).detailed is not None
    assert scored(seen, monkeypatch, (20, 0.2), (19.5, 0.01), (19.5, 0.01)).detailed is None
    # What is not seen outside outweighs nothing.
    assert scored(seen, monkeypatch, (20, 0.004), (19.9, 0.0), (19.9, 0.0)).detailed is None


def test_object_without_what_is_beside_it_is_kept_where_its_training_is_not(
    seen: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, floor = with_floor(seen)
    result = scored(wrong, monkeypatch, (20, 0.2), (19, 0.1), (20, 0.1))
    assert result.detailed is not None and result.record["kept"] and not result.record["trained"]
    kept = result.detailed.parents
    assert not np.isin(floor, kept).any() and wrong.members[kept].all()
    np.testing.assert_array_equal(result.detailed.gaussians.means, seen.gaussians.means[kept])
    assert result.record["psnr"] == [20, 20] and result.record["gaussians"] == [wrong.members.sum(), len(kept)]
    refused = scored(wrong, monkeypatch, (20, 0.2), (19, 0.1), (19.5, 0.1))
    assert refused.detailed is None and "-1.0 dB" in refused.record["why"]


def test_photos_that_the_scene_was_measured_on_decide(tmp_path: Path) -> None:
    def held_out(measured_on: str, **plan: Any) -> frozenset[str]:
        with ProjectFolder.create(tmp_path / measured_on) as project:
            project.put("photo_folder", str(tmp_path))
            figures = {"measured_on": measured_on, "measured_photos": ["a.jpg", "b.jpg"]}
            project.finish_stage("training", "key", wall_seconds=1, cpu_seconds=1, figures=figures)
            return DetailPhotos.of(project).held_out

    assert held_out("test photos") == {"a.jpg", "b.jpg"}
    assert held_out("training photos") == frozenset()


def test_large_photos_are_read_smaller_which_the_record_says(seen: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.objects.detail_cutter._MAX_PIXELS", 24_000)
    result = seen.detail(settings=replace(SMALL, detail_steps=30))
    assert result.record["reduced"] == result.record["photos"] + len(result.record["validation"])
    assert 0.1 < result.record["scale"] < 0.7 and result.record["pixels"] < 2000
    assert not result.record["kept"] or "photos were read smaller" in result.sentence


def test_photos_larger_than_their_maps_are_compared_at_their_own_size(
    seen: Seen, detailed: DetailResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.objects.detail_cutter._MAP_PIXELS", 2000)
    result = seen.detail(settings=replace(SMALL, detail_steps=300))
    assert result.detailed is not None and result.record["reduced"] == 0 and result.record["scale"] == 1
    assert result.record["pixels"] == pytest.approx(detailed.record["pixels"], rel=0.2)
    photo = seen.energy(seen.pixels[TEST_PHOTO] / 255, TEST_PHOTO)
    assert seen.energy(seen.alone(result.detailed.gaussians, TEST_PHOTO)[0], TEST_PHOTO) / photo > 0.35
    assert seen.psnr(result.detailed.gaussians, TEST_PHOTO) > seen.psnr(seen.gaussians[seen.members], TEST_PHOTO) + 2


def test_steps_and_gaussians_are_those_that_the_pixels_justify() -> None:
    assert [_steps(1500, [pixels] * 3) for pixels in (9e4, 8e5, 5e6)] == [1500, 2121, 4500]
    plan = DetailPlan(1500, 20_000)
    assert _max_gaussians(plan, 20_000, 9e4, 1.2) == 3 * 9e4 / 8
    assert _max_gaussians(plan, 20_000, 8e5, 2.5) == 125_000
    assert _max_gaussians(plan, 20_000, 5e6, 6.3) == round(plan.n_compared / 100)
    assert _max_gaussians(replace(plan, steps=4500), 20_000, 5e6, 6.3) == 300_000
    # An object that has more keeps them; few pixels add none.
    assert _max_gaussians(plan, 400_000, 5e6, 6.3) == 400_000
    assert _max_gaussians(plan, 20_000, 100, 6.3) == 20_000


def test_photos_are_read_as_large_as_the_steps_can_compare_them(seen: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.objects.detail_cutter._MAP_PIXELS", 2000)
    few, more = (seen.detail(settings=replace(SMALL, detail_steps=steps)).record for steps in (2, 30))
    assert few["scale"] < more["scale"] == 1 and few["reduced"] == 12 and more["reduced"] == 0
    # Never smaller than the maps.
    assert few["pixels"] > 500


def test_nothing_is_done_without_steps_members_or_photos(seen: Seen) -> None:
    assert seen.detail(settings=replace(SMALL, detail_steps=0)).detailed is None
    assert "it is empty" in replace(seen, members=np.zeros_like(seen.members)).detail().sentence
    few = replace(seen, photos=replace(seen.photos, held_out=frozenset(list(seen.pixels)[2:])))
    assert "only 2 training photos show it" in few.detail().sentence


def test_progress_tells_the_time_left_and_a_cancel_ends_it(seen: Seen) -> None:
    told: list[tuple[float, float | None]] = []
    with pytest.raises(Cancelled, match="nothing was stored"):
        seen.detail(
            tell=lambda done, left: told.append((done, left)),
            should_stop=lambda: bool(told) and told[-1][1] is not None,
        )
    fractions = [done for done, _ in told]
    assert fractions == sorted(fractions) and 0.2 < fractions[-1] < 1 and told[-1][1] > 0


def test_detail_on_the_card_is_as_good_as_on_the_processor(card: Gpu, seen: Seen) -> None:
    results = []
    for backend in ("cpu", "gpu"):
        views = Views(Scene(seen.gaussians, backend=backend), seen.cameras, render_side=160)
        settings = replace(BETTER, render_side=160, detail_steps=20)
        results.append(detail_object(views, seen.photos, seen.members, settings, should_stop=never_stop))
    processor, on_card = (one.record for one in results)
    assert (processor["device"], on_card["device"]) == ("processor", "card")
    assert on_card["psnr"][0] == pytest.approx(processor["psnr"][0], abs=0.02)
    # A fifth of what the steps gain: the devices add in another order.
    assert on_card["psnr"][1] == pytest.approx(processor["psnr"][1], abs=0.05) and on_card["kept"]
    assert on_card["gaussians"] == pytest.approx(processor["gaussians"], rel=0.02)


@pytest.mark.parametrize("demanded", [False, True])
def test_card_that_fails_leaves_detail_to_the_processor_unless_it_is_demanded(
    card: Gpu, seen: Seen, monkeypatch: pytest.MonkeyPatch, demanded: bool
) -> None:
    def fail(*given: Any, **named: Any) -> None:
        raise EnvironmentProblem("The card lacks memory; use another one.")

    monkeypatch.setattr("engine.training.gpu.detail.GpuDetailSteps.grow", fail)
    problems: list[EnvironmentProblem] = []
    scene = Scene(seen.gaussians, backend="gpu", on_failure=None if demanded else problems.append)
    settings = replace(BETTER, render_side=160, detail_steps=40)
    views = Views(scene, seen.cameras, render_side=160)
    if demanded:
        with pytest.raises(EnvironmentProblem, match="lacks memory"):
            detail_object(views, seen.photos, seen.members, settings, should_stop=never_stop)
        return
    record = detail_object(views, seen.photos, seen.members, settings, should_stop=never_stop).record
    assert record["device"] == "processor" and record["steps"] > 0
    assert len(problems) == 1 and "lacks memory" in str(problems[0])


@pytest.fixture
def stored(tmp_path: Path) -> tuple[Path, ObjectRecord, Gaussians, Detailed]:
    """A project folder with an object of rows 3, 5 and 8, of which 3 has one detailed Gaussian and 5 two."""
    gaussians = make_scene().gaussians[np.arange(10)]
    membership = np.isin(np.arange(10), [3, 5, 8]).astype(np.float32)
    rows, parents = np.array([3, 5], np.int32), np.array([3, 5, 5], np.int32)
    own = gaussians[parents]
    other = replace(own, means=own.means + np.arange(1, 4, dtype=np.float32)[:, None], sh=own.sh + 2, features=None)
    detailed = Detailed(rows, gaussians.means[rows], parents, other)
    record = ObjectRecord("one", "One", {"kind": "click"}, 0.5, 1.0, 1.0, 3, 10)
    save_object(tmp_path, record, membership, detailed=detailed)
    return tmp_path, record, gaussians, detailed


def test_exported_object_has_its_detail(stored: tuple[Path, ObjectRecord, Gaussians, Detailed]) -> None:
    project, record, gaussians, detailed = stored
    alone = object_gaussians(project, record, gaussians)
    np.testing.assert_array_equal(alone.means[:3], detailed.gaussians.means)
    np.testing.assert_array_equal(alone.sh[:3], detailed.gaussians.sh)
    np.testing.assert_array_equal(alone.means[3], gaussians.means[8])
    np.testing.assert_array_equal(alone.features, gaussians.features[[3, 5, 5, 8]])
    with pytest.raises(ObjectError, match="earlier training"):
        object_gaussians(project, record, gaussians[np.arange(9)])


def test_gaussians_moved_by_hand_stay_where_they_were_put(
    stored: tuple[Path, ObjectRecord, Gaussians, Detailed],
) -> None:
    project, _, gaussians, _ = stored
    detailed = load_detailed(project, "one")
    assert detailed is not None
    means = gaussians.means.copy()
    means[5] += 7
    joined, source = detailed.with_detail(replace(gaussians, means=means)[np.array([5, 3, 4])], np.array([5, 3, 4]))
    np.testing.assert_array_equal(joined.means, [means[5], detailed.gaussians.means[0], means[4]])
    np.testing.assert_array_equal(source, [0, 1, 2])


def test_changed_object_loses_its_detail(stored: tuple[Path, ObjectRecord, Gaussians, Detailed]) -> None:
    project, record, gaussians, _ = stored
    save_object(project, record, np.ones(10, np.float32))
    assert load_detailed(project, "one") is None
    np.testing.assert_array_equal(object_gaussians(project, record, gaussians).means, gaussians.means)


@pytest.mark.parametrize("damage", ["cut", "other", "no archive", "encrypted", "newer", "narrow"])
def test_damaged_file_is_named(stored: tuple[Path, ObjectRecord, Gaussians, Detailed], damage: str) -> None:
    file = stored[0] / "objects" / "one" / "detail.npz"
    data = bytearray(file.read_bytes())
    directory = data.index(b"PK\x01\x02")
    match damage:
        case "cut":
            del data[200:]
        case "encrypted":
            data[directory + 8] |= 1
        case "newer":
            data[directory + 6] = 210
        case "no archive":
            np.save(file.with_suffix(".npy"), np.arange(3))
            data = bytearray(file.with_suffix(".npy").read_bytes())
    file.write_bytes(data)
    if damage == "other":
        np.savez(file, rows=np.arange(3))
    if damage == "narrow":
        with np.load(file) as archive:
            np.savez(file, **{**archive, "quats": archive["quats"][:, :3]})
    with pytest.raises(FormatError, match="detail.npz cannot be read.*Isolate the object again"):
        load_detailed(stored[0], "one")
