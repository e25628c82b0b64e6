"""A polished object is opaque and ends at its outline."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import Cancelled, FormatError, ObjectError
from engine.core.events import never_stop
from engine.objects.polishing import polish
from engine.objects.settings import BETTER
from engine.objects.storage import object_gaussians, save_object
from engine.objects.views import Views, erode_mask
from engine.pictures.scene import Scene
from engine.project.objects import ObjectRecord
from engine.scene.gaussians import Gaussians
from engine.scene.polished import Polished, load_polished
from tests.engine.pictures.blob_scene import RED, BlobScene, as_pinhole, make_scene

SMALL = replace(BETTER, render_side=160, polish_steps=120)


@pytest.fixture(scope="module")
def spiked() -> tuple[BlobScene, np.ndarray]:
    """Return a translucent red ball with a green ball in it and a spike that the floor hides, and its members."""
    scene = make_scene()
    ball = np.flatnonzero(scene.part == RED)
    logits, means, log_scales = (
        getattr(scene.gaussians, name).copy() for name in ("opacity_logits", "means", "log_scales")
    )
    logits[ball] = -1.0
    inner = np.flatnonzero(scene.part == RED + 1)
    means[inner] = means[ball].mean(axis=0) + 0.5 * (means[inner] - means[inner].mean(axis=0))
    sh = scene.gaussians.sh.copy()
    sh[inner, 0] = (-1.7, 1.7, -1.7)
    spike = ball[0]
    means[spike] = means[ball].mean(axis=0) + (-0.5, 0.0, -0.4)
    log_scales[spike], logits[spike] = np.log([0.2, 0.2, 0.02]), 4.0
    gaussians = replace(scene.gaussians, means=means, log_scales=log_scales, opacity_logits=logits, sh=sh)
    return replace(scene, gaussians=gaussians), scene.part == RED


def views_of(scene: BlobScene) -> Views:
    return Views(Scene(scene.gaussians), scene.cameras, render_side=160)


def coverage(gaussians: Gaussians, scene: BlobScene) -> list[np.ndarray]:
    return [Scene(gaussians).render(as_pinhole(camera), color=True).alpha for camera in scene.cameras.cameras]


def test_translucent_object_becomes_opaque_and_loses_its_spike(spiked: tuple[BlobScene, np.ndarray]) -> None:
    scene, members = spiked
    polished = polish(views_of(scene), members, SMALL, should_stop=never_stop)
    assert polished is not None
    trained = scene.gaussians[members]
    inside = [erode_mask(scene.labels[camera.photo] == RED, 3) for camera in scene.cameras.cameras]
    spike = coverage(trained[np.arange(1)], scene)
    outside = [(one > 0.5) & (labels == 0) for one, labels in zip(spike, scene.labels.values(), strict=True)]

    def mean_over(gaussians: Gaussians, masks: list[np.ndarray]) -> float:
        pixels = [one[mask] for one, mask in zip(coverage(gaussians, scene), masks, strict=True)]
        return float(np.concatenate(pixels).mean())

    assert mean_over(trained, inside) < 0.93 < 0.98 < mean_over(polished.gaussians, inside)
    assert mean_over(trained, outside) > 0.7 > 0.35 > mean_over(polished.gaussians, outside)


def test_colour_of_the_background_is_not_mixed_in(spiked: tuple[BlobScene, np.ndarray]) -> None:
    scene, members = spiked
    polished = polish(views_of(scene), members, SMALL, should_stop=never_stop)
    assert polished is not None
    for camera in scene.cameras.cameras:
        inside = erode_mask(scene.labels[camera.photo] == RED, 9)
        seen = Scene(polished.gaussians).render(as_pinhole(camera), color=True).channels[inside]
        np.testing.assert_allclose(np.median(seen, axis=0), (0.85, 0.2, 0.15), atol=0.05)


def test_part_hidden_by_an_occluder_stays() -> None:
    scene = make_scene()
    members, wall = scene.part == RED, np.flatnonzero(scene.part == RED + 1)
    means, log_scales, logits = (
        getattr(scene.gaussians, name).copy() for name in ("means", "log_scales", "opacity_logits")
    )
    cameras, middle = scene.cameras.cameras, means[members].mean(axis=0)
    # In front of all cameras but two, so that few views show the ball.
    for i, camera in enumerate(cameras[2:]):
        blob = wall[20 * i : 20 * i + 20]
        means[blob] = middle + 0.45 * (camera.center - middle)
        log_scales[blob], logits[blob] = np.log(0.12), 4.0
    hidden = replace(
        scene, gaussians=replace(scene.gaussians, means=means, log_scales=log_scales, opacity_logits=logits)
    )
    polished = polish(views_of(hidden), members, SMALL, should_stop=never_stop)
    assert polished is not None
    before, after = coverage(scene.gaussians[members], scene), coverage(polished.gaussians, scene)
    ratios = [new[old > 0.5].mean() / old[old > 0.5].mean() for old, new in zip(before, after, strict=True)]
    assert min(ratios) > 0.9, ratios


def test_polishing_repeats_exactly_and_leaves_the_scene_alone(spiked: tuple[BlobScene, np.ndarray]) -> None:
    scene, members = spiked
    before = scene.gaussians.means.copy()
    one, other = (
        polish(views_of(scene), members, replace(SMALL, polish_steps=10), should_stop=never_stop) for _ in range(2)
    )
    assert one is not None and other is not None
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(one.gaussians, name), getattr(other.gaussians, name))
    np.testing.assert_array_equal(scene.gaussians.means, before)
    np.testing.assert_array_equal(one.trained_means, before[members])


def test_nothing_is_polished_without_steps_members_or_views(spiked: tuple[BlobScene, np.ndarray]) -> None:
    scene, members = spiked
    views = views_of(scene)
    assert polish(views, members, replace(SMALL, polish_steps=0), should_stop=never_stop) is None
    assert polish(views, np.zeros_like(members), SMALL, should_stop=never_stop) is None
    high = scene.gaussians.means.copy()
    high[members, 2] += 50
    nowhere = replace(scene, gaussians=replace(scene.gaussians, means=high))
    assert polish(views_of(nowhere), members, SMALL, should_stop=never_stop) is None


def test_polishing_can_be_cancelled(spiked: tuple[BlobScene, np.ndarray]) -> None:
    with pytest.raises(Cancelled, match="no object was stored"):
        polish(views_of(spiked[0]), spiked[1], SMALL, should_stop=lambda: True)


@pytest.fixture
def stored(tmp_path: Path) -> tuple[Path, ObjectRecord, Gaussians, Polished]:
    """Return a project folder with an object of rows 3, 5 and 8, of which the first two are polished, and its scene."""
    gaussians = make_scene().gaussians[np.arange(10)]
    membership = np.isin(np.arange(10), [3, 5, 8]).astype(np.float32)
    rows = np.array([3, 5], np.int32)
    other = replace(gaussians[rows], means=gaussians.means[rows] + 1, sh=gaussians.sh[rows] + 2, features=None)
    polished = Polished(rows, gaussians.means[rows], other)
    record = ObjectRecord("one", "One", {"kind": "click"}, 0.5, 1.0, 1.0, 3, 10)
    save_object(tmp_path, record, membership, polished=polished)
    return tmp_path, record, gaussians, polished


def test_exported_object_has_its_polished_gaussians(stored: tuple[Path, ObjectRecord, Gaussians, Polished]) -> None:
    project, record, gaussians, polished = stored
    alone = object_gaussians(project, record, gaussians)
    np.testing.assert_array_equal(alone.means[:2], polished.gaussians.means)
    np.testing.assert_array_equal(alone.sh[:2], polished.gaussians.sh)
    np.testing.assert_array_equal(alone.means[2], gaussians.means[8])
    np.testing.assert_array_equal(alone.features, gaussians.features[[3, 5, 8]])
    with pytest.raises(ObjectError, match="earlier training"):
        object_gaussians(project, record, gaussians[np.arange(9)])


def test_gaussians_moved_by_hand_stay_where_they_were_put(
    stored: tuple[Path, ObjectRecord, Gaussians, Polished],
) -> None:
    project, _, gaussians, _ = stored
    polished = load_polished(project, "one")
    assert polished is not None
    means = gaussians.means.copy()
    means[5] += 7
    joined = polished.with_polished(replace(gaussians, means=means)[np.array([5, 3, 4])], np.array([5, 3, 4]))
    np.testing.assert_array_equal(joined.means, [means[5], polished.gaussians.means[0], means[4]])


def test_changed_object_loses_its_polished_gaussians(stored: tuple[Path, ObjectRecord, Gaussians, Polished]) -> None:
    project, record, gaussians, _ = stored
    save_object(project, record, np.ones(10, np.float32))
    assert load_polished(project, "one") is None
    np.testing.assert_array_equal(object_gaussians(project, record, gaussians).means, gaussians.means)


@pytest.mark.parametrize("damage", ["cut", "other", "no archive", "encrypted", "newer", "narrow"])
def test_damaged_file_is_named(stored: tuple[Path, ObjectRecord, Gaussians, Polished], damage: str) -> None:
    file = stored[0] / "objects" / "one" / "polished.npz"
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
    with pytest.raises(FormatError, match="polished.npz cannot be read.*Isolate the object again"):
        load_polished(stored[0], "one")
