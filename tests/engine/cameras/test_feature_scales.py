"""Zooms are guessed from the sizes of features that photos have in common."""

from __future__ import annotations

import numpy as np
import pytest

from engine.cameras.feature_scales import SIZES_DIFFER, balanced_scales, ids_at_gap, largest_gap, scale_groups


def ratios_of(scales: list[float], *, noise: float = 0.02) -> list[tuple[int, int, int, float]]:
    """Return pairs (first, second, matches, ratio) of photos whose logarithms of scale are `scales`."""
    rng = np.random.default_rng(0)
    count = len(scales)
    return [
        (a, b, 60, scales[b] - scales[a] + rng.normal(0.0, noise))
        for a in range(count)
        for b in (a + 1, a + 2)
        if b < count
    ]


def test_scales_of_photos_are_found_from_their_pairs_though_one_pair_is_wrong() -> None:
    true = [0.0, 0.5, 0.05, 0.45, -0.1, 0.6, 0.0, 0.5]
    pairs = ratios_of(true)
    pairs[4] = (*pairs[4][:3], 2.0)
    found = balanced_scales(range(len(true)), pairs)
    assert np.array(list(found.values())) == pytest.approx(np.array(true) - np.mean(true), abs=0.06)


def test_a_photo_without_pairs_has_the_mean_scale() -> None:
    assert balanced_scales(range(4), ratios_of([0.1, 0.3, 0.5]))[3] == pytest.approx(0.0, abs=1e-6)


def test_photos_of_two_zooms_make_two_groups() -> None:
    scales = {i: (0.45 if i % 2 else 0.0) + 0.05 * np.sin(i) for i in range(12)}
    groups = scale_groups(scales, 2)
    assert [members for _, members in groups] == [[0, 2, 4, 6, 8, 10], [1, 3, 5, 7, 9, 11]]
    assert groups[1][0] - groups[0][0] == pytest.approx(0.45, abs=0.06)


def test_photos_of_three_zooms_make_three_groups() -> None:
    scales = {i: (0.0, 0.35, 0.8)[i % 3] + 0.04 * np.cos(i) for i in range(12)}
    assert [members for _, members in scale_groups(scales, 3)] == [[0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11]]


def test_photos_of_nearly_one_scale_and_few_photos_make_no_groups() -> None:
    assert scale_groups({i: 0.03 * (i % 3) for i in range(12)}, 2) == []
    assert scale_groups({0: 0.0, 1: 0.5, 2: 1.0}, 2) == []


def test_photos_of_two_zooms_fall_apart_and_those_of_a_walk_do_not() -> None:
    zoomed = [(0.45 if i % 2 else 0.0) + 0.05 * np.sin(i) for i in range(12)]
    assert largest_gap(zoomed) == pytest.approx(np.exp(0.36), rel=0.02)
    # A walk from far to near changes sizes by a factor of 2, little by little.
    assert largest_gap(list(np.linspace(0.0, np.log(2.0), 12))) < 1.1 < SIZES_DIFFER


def test_one_photo_from_near_and_three_photos_are_no_groups() -> None:
    assert largest_gap([0.0, 0.02, 0.05, 0.08, 0.9]) < 1.05
    assert largest_gap([0.0, 0.5, 1.0]) == 1.0


def test_photos_on_both_sides_of_a_gap_are_chosen_and_all_are_connected() -> None:
    # Photos 0 to 19 from far, 20 to 39 from near; each matches the next two, and 40 and 41 match only each other.
    scales = [0.0] * 20 + [0.5] * 20
    pairs = [*ratios_of(scales), (40, 41, 900, 3.0)]
    chosen = ids_at_gap(range(42), pairs, 10)
    assert len(chosen) == 10 and {18, 19, 20, 21} <= chosen
    assert set(np.diff(sorted(chosen)).tolist()) <= {1, 2}
    assert len(ids_at_gap(range(42), pairs, 60)) == 40
