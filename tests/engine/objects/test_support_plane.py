"""Objects are cut off at their support plane, where the figure widens on the way down."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.events import never_stop
from engine.objects.context import load_context
from engine.objects.hierarchy import Hierarchy
from engine.objects.levels import find_levels
from engine.objects.settings import BETTER
from engine.objects.support_plane import cut_at_support_planes, upper_parts
from tests.engine.objects.fakes import FakeSam, trained_project
from tests.engine.pictures.blob_scene import BLUE, RED, make_scene

HEIGHTS = {"plinth": (-1.0, 0.0, 0.5), "base": (0.0, 0.12, 0.22), "stem": (0.12, 0.4, 0.05), "bowl": (0.4, 0.8, 0.3)}


def goblet_on_a_plinth() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return points on the surfaces of four cylinders above each other, and which are of which."""
    random = np.random.default_rng(0)
    parts = []
    for bottom, top, radius in HEIGHTS.values():
        angle, height = random.uniform(0, 2 * np.pi, 600), random.uniform(bottom, top, 600)
        sides = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
        reach = radius * np.sqrt(random.uniform(0, 1, 300))
        lid = np.column_stack([reach * np.cos(angle[:300]), reach * np.sin(angle[:300]), np.full(300, top)])
        parts.append(np.vstack([sides, lid]))
    of = np.repeat(np.arange(len(parts)), [len(one) for one in parts])
    return np.vstack(parts).astype(np.float32), {name: of == i for i, name in enumerate(HEIGHTS)}


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def one_group(members: np.ndarray) -> Hierarchy:
    return Hierarchy(np.where(members, 0, -1).astype(np.int32), np.array([[0, 1]], np.int32), np.ones(1, np.float32))


def test_goblet_is_cut_off_its_plinth_below_its_base() -> None:
    means, part = goblet_on_a_plinth()
    everything = np.ones(len(means), bool)
    found = upper_parts(means, everything)
    goblet = next(one for one in found if iou(one.members, everything & ~part["plinth"]) > 0.9)
    cup = next(one for one in found if iou(one.members, part["bowl"] | part["stem"]) > 0.9)
    assert goblet.above_support
    assert not cup.above_support, "the bowl is wider than the base"


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_gaussians_have_no_parts(count: int) -> None:
    assert upper_parts(np.zeros((count, 3), np.float32), np.ones(count, bool)) == []


def test_box_of_one_width_has_no_parts() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (4000, 3)).astype(np.float32)
    assert upper_parts(points, np.ones(len(points), bool)) == []


def test_bowl_and_stem_get_their_base_and_goblet_with_plinth_loses_the_plinth() -> None:
    means, part = goblet_on_a_plinth()
    goblet, everything = ~part["plinth"], np.ones(len(means), bool)
    for known in (goblet & ~part["base"], everything):
        membership = np.where(known, 0.8, 0.1).astype(np.float32)
        found = cut_at_support_planes(means, membership, one_group(everything))
        best = max(found, key=lambda one: iou(one.membership >= 0.5, goblet))
        belongs = best.membership >= 0.5
        assert iou(belongs, goblet) > 0.9
        assert (best.membership[known & belongs] == np.float32(0.8)).all(), "known members keep their membership"
        assert best.adds_base == (known.sum() < goblet.sum())


def test_group_that_is_not_around_the_object_is_ignored() -> None:
    means, part = goblet_on_a_plinth()
    membership = np.where(part["bowl"], 0.8, 0.1).astype(np.float32)
    others = one_group(part["plinth"] | part["base"])
    assert all(
        not (one.membership >= 0.5)[part["base"]].any() for one in cut_at_support_planes(means, membership, others)
    )


def test_word_for_an_object_that_lost_its_base_restores_the_base(tmp_path: Path) -> None:
    scene = make_scene()
    whole, plate = scene.part == BLUE, scene.part == RED
    means = scene.gaussians.means.copy()
    low, high = means[whole].min(axis=0), means[whole].max(axis=0)
    random = np.random.default_rng(0)
    spread = random.uniform(-1.2, 1.2, (int(plate.sum()), 2)) * (high - low)[:2]
    means[plate] = np.column_stack([(low + high)[:2] / 2 + spread, np.full(int(plate.sum()), low[2] - 0.02)])
    scene = replace(scene, gaussians=replace(scene.gaussians, means=means.astype(np.float32)))
    settings = replace(BETTER, photo_side=160, render_side=160, erode_pixels=1, n_level_views=6)
    context = load_context(trained_project(scene, tmp_path), settings, lambda: FakeSam(scene))
    cut = whole & (means[:, 2] > low[2] + 0.2 * (high - low)[2])
    sizes = {}
    for hierarchy in (None, one_group(whole | plate)):
        levels = find_levels(
            context, cut.astype(np.float32), np.zeros((0, 16), np.float32), settings,
            scorer=lambda members: 0.9, hierarchy=hierarchy, should_stop=never_stop,
        )  # fmt: skip
        sizes[hierarchy is None] = iou(levels.membership >= 0.5, whole)
    assert sizes[True] == iou(cut, whole)
    assert sizes[False] > max(0.95, sizes[True])
