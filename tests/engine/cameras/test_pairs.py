"""Quick matching selects the pairs of photos that show the same features."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.cameras import pairs as pairs_module
from engine.cameras.pairs import (
    all_pairs,
    largest_descriptors,
    promising_pairs,
    quick_matches,
    quick_matches_with_each,
)
from engine.cameras.retrieval import similar_pairs
from engine.core.errors import Cancelled


def around(count: int, *, seen: int = 80, step: int = 20) -> list[NDArray[np.float32]]:
    """Return descriptors of photos around an object: each shows `seen` features of a ring, `step` after the last."""
    rng = np.random.default_rng(0)
    ring = rng.uniform(0, 1, (count * step, 128))
    photos = []
    for index in range(count):
        chosen = ring[(np.arange(seen) + index * step) % len(ring)] + rng.normal(0, 0.01, (seen, 128))
        photos.append((chosen / np.linalg.norm(chosen, axis=1, keepdims=True)).astype(np.float32))
    return photos


def test_overlapping_photos_are_paired_and_distant_ones_are_not() -> None:
    pairs = promising_pairs(around(40), neighbours=2, report=lambda done: None, should_stop=lambda: False)
    assert all(i < j for i, j in pairs)
    apart = [min(j - i, 40 - (j - i)) for i, j in pairs]
    assert {(i, (i + 2) % 40) for i in range(38)} <= set(pairs)
    assert max(apart) <= 4
    assert len(pairs) < len(all_pairs(40)) / 4


def test_photos_without_features_are_paired_with_the_next_ones() -> None:
    photos = around(6)
    photos[3] = np.zeros((0, 128), np.float32)
    pairs = promising_pairs(photos, neighbours=2, report=lambda done: None, should_stop=lambda: False)
    assert {(3, 4), (3, 5), (2, 3)} <= set(pairs)


@pytest.mark.parametrize("kept", [0, 1, 2, 80])
def test_several_photos_compared_at_a_time_have_the_matches_of_each_pair(kept: int) -> None:
    photos = around(30)
    photos[4], photos[9] = photos[4][:kept], photos[9][:30]
    for first in (photos[3], photos[4]):
        assert quick_matches_with_each(first, photos) == [quick_matches(first, other) for other in photos]


def test_progress_reaches_one_and_a_stop_is_respected() -> None:
    reported: list[float] = []
    promising_pairs(around(5), neighbours=2, report=reported.append, should_stop=lambda: False)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    with pytest.raises(Cancelled):
        promising_pairs(around(5), neighbours=2, report=lambda done: None, should_stop=lambda: True)


def test_the_largest_features_are_selected() -> None:
    scales = np.arange(1000, dtype=np.float32)
    descriptors = np.zeros((1000, 128), np.uint8)
    descriptors[:, 0] = 200
    descriptors[990:, 1] = 200
    chosen = largest_descriptors(scales, descriptors, photos=20)
    assert chosen.shape == (600, 128)
    assert np.allclose(np.linalg.norm(chosen, axis=1), 1.0)
    assert (chosen[:10, 1] > 0).all()
    assert (chosen[10:, 1] == 0).all()
    assert largest_descriptors(scales, descriptors, photos=200).shape == (300, 128)


def test_many_photos_are_compared_with_similar_ones_only_and_the_same_neighbours_are_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    photos = around(40)
    every = promising_pairs(photos, neighbours=2, report=lambda done: None, should_stop=lambda: False)
    compared: list[int] = []

    def counted(first: NDArray[np.float32], others: Sequence[NDArray[np.float32]]) -> list[int]:
        compared.append(len(others))
        return quick_matches_with_each(first, others)

    monkeypatch.setattr(pairs_module, "EVERY_PAIR_UP_TO", 30)
    monkeypatch.setattr(pairs_module, "_SIMILAR", 8)
    monkeypatch.setattr(pairs_module, "quick_matches_with_each", counted)
    found = promising_pairs(photos, neighbours=2, report=lambda done: None, should_stop=lambda: False)
    assert sum(compared) <= pairs_module.comparison_work(40) == 8 * 40
    # Photos show 80 features, 20 further for each step: three steps apart they share 20.
    near = {(i, j) for i, j in every if min(j - i, 40 - (j - i)) <= 3}
    assert near <= set(found)


def test_similar_photos_are_those_that_show_the_same_and_a_photo_without_features_has_none() -> None:
    photos = around(40)
    photos[7] = np.zeros((0, 128), np.float32)
    found = similar_pairs(photos, partners=4, seed=0)
    assert found == sorted(set(found)) == similar_pairs(photos, partners=4, seed=0)
    assert all(i < j for i, j in found)
    assert not [pair for pair in found if 7 in pair]
    assert {(i, i + 1) for i in range(39) if 7 not in (i, i + 1)} <= set(found)
