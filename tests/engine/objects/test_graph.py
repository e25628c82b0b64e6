from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from engine.core.errors import Cancelled
from engine.core.events import never_stop
from engine.masks import mask_iou
from engine.objects.graph import SceneGraph, build_graph
from engine.objects.graph_file import load_or_build_graph
from engine.objects.views import Views
from engine.objects.votes import MaskEvidence, Votes, count_votes
from engine.pictures.scene import Scene
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


@pytest.fixture(scope="module")
def views(blobs: BlobScene) -> Views:
    return Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)


@pytest.fixture(scope="module")
def graph(blobs: BlobScene, views: Views) -> SceneGraph:
    return build_graph(views, blobs.labels, n_views=8, should_stop=never_stop)


def mask_of(blobs: BlobScene, views: Views, part: int, number: int) -> MaskEvidence:
    camera = blobs.cameras.cameras[number]
    view = views.of(camera)
    return MaskEvidence(view, view.from_photo(blobs.labels[camera.photo] == part), 1.0)


def solved(graph: SceneGraph, votes: Votes, strictness: float = 0.6) -> np.ndarray:
    return graph.solve(Votes(votes.inside[:, None], votes.outside[:, None]), strictness)[:, 0]


def test_one_mask_and_the_segments_of_all_photos_give_the_whole_object(
    blobs: BlobScene, views: Views, graph: SceneGraph
) -> None:
    for part in (RED, TWIN, BLUE):
        votes = count_votes(views, mask_of(blobs, views, part, 1), graph.pixels)
        assert mask_iou(solved(graph, votes) >= 0.5, blobs.part == part) > 0.95


def test_membership_falls_as_the_strictness_rises(blobs: BlobScene, views: Views, graph: SceneGraph) -> None:
    votes = count_votes(views, mask_of(blobs, views, BLUE, 1), graph.pixels)
    each = [solved(graph, votes, strictness) for strictness in (0.05, 0.2, 0.6, 2.0, 10.0)]
    for looser, stricter in zip(each, each[1:], strict=False):
        # The tolerance is that of the solution.
        assert (stricter <= looser + 1e-3).all()
    assert all(one.min() >= 0 and one.max() <= 1 for one in each)


def test_without_votes_for_an_object_nothing_belongs(graph: SceneGraph) -> None:
    nothing = np.zeros(len(graph.pixels), np.float32)
    assert solved(graph, Votes(nothing, nothing)).max() == 0


def exact(graph: SceneGraph, votes: Votes, strictness: float = 0.6, shown: float = np.inf) -> np.ndarray:
    """The membership as docs/objects.md states it: a direct solve in float64, with the segments as unknowns."""
    pixels = graph.segments.toarray().astype(float)[:, graph.is_segment]
    links = 0.02 * pixels * np.minimum(1, 2 * shown / np.maximum(pixels.sum(axis=0), 1e-9))
    n, m = links.shape
    weights = np.block([[graph.neighbours.toarray(), links], [links.T, np.zeros((m, m))]])
    inside, outside = (np.pad(one[:, 0].astype(float), (0, m)) for one in (votes.inside, votes.outside))
    against = strictness * outside + 0.02 * (np.arange(n + m) < n)
    return np.linalg.solve(np.diag(weights.sum(axis=1) + inside + against) - weights, inside)[:n]


def test_membership_solves_the_system_that_the_documentation_states(
    blobs: BlobScene, views: Views, graph: SceneGraph
) -> None:
    one = count_votes(views, mask_of(blobs, views, RED, 0), graph.pixels)
    votes = Votes(one.inside[:, None], one.outside[:, None])
    np.testing.assert_allclose(graph.solve(votes, 0.6)[:, 0], exact(graph, votes), atol=0.01)
    weighted = graph.solve(votes, 0.6, shown=60.0)[:, 0]
    np.testing.assert_allclose(weighted, exact(graph, votes, shown=60.0), atol=0.01)
    assert np.abs(weighted - graph.solve(votes, 0.6)[:, 0]).max() > 0.05


def test_objects_that_are_solved_together_are_what_they_are_alone(
    blobs: BlobScene, views: Views, graph: SceneGraph
) -> None:
    each = [count_votes(views, mask_of(blobs, views, part, 0), graph.pixels) for part in (RED, BLUE)]
    strictness, shown = np.array([0.6, 0.02], np.float32), np.array([60, 500], np.float32)
    together = Votes(*(np.column_stack([getattr(one, side) for one in each]) for side in ("inside", "outside")))
    solution = graph.solve(together, strictness, shown)
    for k, one in enumerate(each):
        alone = Votes(one.inside[:, None], one.outside[:, None])
        # Together, all are iterated as often as the slowest; either is within 0.01 of a direct solve.
        np.testing.assert_allclose(solution[:, k], graph.solve(alone, strictness[k], shown[k])[:, 0], atol=0.01)


@pytest.mark.parametrize("cores", [1, 3, 16])
def test_object_has_the_same_bits_on_any_number_of_cores(
    cores: int, graph: SceneGraph, blobs: BlobScene, views: Views
) -> None:
    votes = count_votes(views, mask_of(blobs, views, BLUE, 1), graph.pixels)
    both = Votes(np.stack([votes.inside] * 2, axis=1), np.stack([votes.outside] * 2, axis=1))
    strictness = np.array([0.6, 2.0], np.float32)
    shared = graph.solve(both, strictness, 50.0, n_threads=cores)
    np.testing.assert_array_equal(shared, graph.solve(both, strictness, 50.0))


def test_object_does_not_depend_on_the_order_of_the_gaussians(
    blobs: BlobScene, views: Views, graph: SceneGraph
) -> None:
    votes = count_votes(views, mask_of(blobs, views, BLUE, 1), graph.pixels)
    mixed = np.random.default_rng(0).permutation(len(graph.pixels))
    other = replace(graph, neighbours=graph.neighbours[mixed][:, mixed], segments=graph.segments[mixed])
    found = solved(other, Votes(votes.inside[mixed], votes.outside[mixed]))
    # The tolerance is that of the solution.
    np.testing.assert_allclose(found, solved(graph, votes)[mixed], atol=0.01)


def test_a_door_that_most_photos_leave_in_the_segment_of_its_wall_is_whole() -> None:
    n_door, n_wall, pixels = 20, 400, 10.0
    door = np.arange(n_door + n_wall) < n_door
    parts = [np.column_stack([np.zeros_like(door), door, ~door])]  # the rest, the door, the wall
    parts += 3 * [np.column_stack([np.zeros_like(door), np.ones_like(door)])]
    segments = csr_matrix(pixels * np.hstack(parts).astype(np.float32))
    photo = np.repeat(np.arange(4, dtype=np.int32), [3, 2, 2, 2])
    graph = SceneGraph(csr_matrix((len(door), len(door)), dtype=np.float32), segments, photo, ("a", "b", "c", "d"))
    inside = np.where(np.arange(len(door)) < n_door // 2, pixels, 0).astype(np.float32)  # it shows half of the door
    votes = Votes(inside[:, None], (~door * pixels).astype(np.float32)[:, None])
    assert ((graph.memberships(votes, 0.6)[0] >= 0.5) == (inside > 0)).all()
    assert ((graph.memberships(votes, 0.6, shown=inside.sum())[0] >= 0.5) == door).all()


def filled_by_one(pixels: float) -> SceneGraph:
    """24 photos, in each of which one Gaussian alone fills `pixels` of a segment; 49 others hang on it in a chain."""
    segments = np.random.default_rng(0).uniform(0, 5, (50, 48)).astype(np.float32)
    segments[:, 1::2], segments[0] = 0, 0
    segments[0, 1::2] = pixels
    chain = np.diag(np.r_[0.001, np.full(48, 0.9)], k=1)
    photo = np.repeat(np.arange(24), 2).astype(np.int32)
    neighbours = csr_matrix((chain + chain.T).astype(np.float32))
    return SceneGraph(neighbours, csr_matrix(segments), photo, tuple(f"{k}.jpg" for k in range(24)))


@pytest.mark.parametrize("pixels", [1.0, 480.0 * 480.0])
@pytest.mark.parametrize("against", [0.0, 1.0])
def test_a_gaussian_that_fills_all_photos_has_the_membership_of_its_weak_votes(pixels: float, against: float) -> None:
    graph, one = filled_by_one(pixels), np.eye(50, 1, dtype=np.float32)
    votes = Votes(one, against * one)
    np.testing.assert_allclose(graph.solve(votes, 0.6)[:, 0], exact(graph, votes), atol=0.02)


def test_memberships_are_finite_where_float32_cannot_solve_the_system() -> None:
    inside = np.zeros((50, 2), np.float32)
    inside[0, 0], inside[10, 1] = 1, 5
    found = filled_by_one(1e10).solve(Votes(inside, np.zeros_like(inside)), 0.6)
    assert ((found >= 0) & (found <= 1)).all()


def test_of_an_object_in_parts_the_light_ones_are_left_out() -> None:
    # Two linked pairs, and one Gaussian alone; a segment of all of them, with many pixels, makes all belong.
    links = csr_matrix((np.ones(2, np.float32), ([0, 2], [1, 3])), shape=(5, 5))
    fused = csr_matrix(np.column_stack([np.zeros(5), np.full(5, 1e6)]).astype(np.float32))
    graph = SceneGraph(csr_matrix(links + links.T), fused, np.zeros(2, np.int32), ("photo",))
    inside = np.array([[50, 50, 0.5, 0.5, 0.9]], np.float32).T
    votes = Votes(inside, np.zeros_like(inside))
    assert (graph.solve(votes, 1.0) > 0.9).all()
    kept = graph.memberships(votes, 1.0)[0]
    # The lightest part that stays has a hundredth of the weight of the heaviest.
    assert (kept[:4] > 0.9).all() and kept[4] == 0
    unlinked = graph.without("neighbours")
    assert (unlinked.memberships(votes, 1.0) > 0.9).all(), "without links there are no parts"
    nothing = Votes(np.zeros_like(inside), inside)
    assert not graph.memberships(nothing, 1.0).any()


def test_pixels_that_show_a_set_are_those_of_its_gaussians_in_each_photo(blobs: BlobScene, graph: SceneGraph) -> None:
    sets = csr_matrix(np.stack([blobs.part == BLUE, blobs.part == RED, blobs.part > 0]), dtype=np.float32)
    shown = graph.shown(sets)
    assert shown.shape == (3, len(graph.photos)) and (shown > 0).all()
    for number in range(len(graph.photos)):
        columns = graph.segments[:, graph.photo == number]
        np.testing.assert_allclose(shown[:, number], (sets @ columns).sum(axis=1).A1, rtol=1e-5)


def test_segments_of_the_photos_agree_with_a_thing_more_than_with_its_part_or_two_things(
    blobs: BlobScene, graph: SceneGraph
) -> None:
    blue = blobs.part == BLUE
    sets = np.stack([blue, blue & (blobs.gaussians.means[:, 2] > 0), blue | (blobs.part == RED), np.zeros_like(blue)])
    whole, part, two, nothing = graph.outline_agreement(csr_matrix(sets, dtype=np.float32))
    assert whole > 0.8 and whole > part + 0.1 and whole > two + 0.1 and nothing == 0


def test_outlines_show_which_gaussians_of_a_set_are_something_else(blobs: BlobScene, graph: SceneGraph) -> None:
    blue, red = blobs.part == BLUE, blobs.part == RED
    strip = red & (np.cumsum(red) <= 0.1 * red.sum())
    shares = graph.outline_shares(blue | strip, 0.75, by_most=True)
    assert np.nanmedian(shares[blue]) > 0.9 and np.nanmax(shares[strip]) < 0.2
    seen = np.isfinite(shares)
    assert seen[blue].any() and ((shares[seen] >= 0) & (shares[seen] <= 1)).all()
    two = graph.outline_shares(blue | red, 0.75, by_most=True)
    assert np.isnan(two).all(), "no segment is the outline of two balls"


def test_graph_is_kept_and_made_again_when_the_scene_or_the_file_changed(
    blobs: BlobScene, views: Views, graph: SceneGraph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "graph.npz"
    built: list[int] = []

    def build(*arguments: object, **others: object) -> SceneGraph:
        built.append(1)
        return graph

    monkeypatch.setattr("engine.objects.graph_file.build_graph", build)

    def load(given: Views = views) -> SceneGraph:
        return load_or_build_graph(file, given, blobs.labels, n_views=8, should_stop=never_stop)

    load()
    kept = load()
    assert built == [1]
    assert (kept.neighbours != graph.neighbours).nnz == 0 and (kept.segments != graph.segments).nnz == 0
    np.testing.assert_array_equal(kept.photo, graph.photo)
    assert kept.photos == graph.photos
    moved = replace(blobs.gaussians, means=blobs.gaussians.means + 1)
    load(Views(Scene(moved), blobs.cameras, render_side=160))
    assert built == [1, 1]
    file.write_bytes(file.read_bytes()[:-40])
    load()
    assert built == [1, 1, 1]


def test_stopping_while_the_graph_is_made_is_reported(blobs: BlobScene, views: Views) -> None:
    with pytest.raises(Cancelled, match="no object was stored"):
        build_graph(views, blobs.labels, n_views=8, should_stop=lambda: True)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_handful_of_gaussians_has_a_graph(count: int, blobs: BlobScene) -> None:
    few = Views(Scene(blobs.gaussians[:count]), blobs.cameras, render_side=160)
    graph = build_graph(few, {}, n_views=8, should_stop=never_stop)
    ones = np.ones(count, np.float32)
    assert solved(graph, Votes(ones, 0 * ones)).min() > 0.5
    assert graph.shown(csr_matrix(ones[None])).shape == (1, 0)
