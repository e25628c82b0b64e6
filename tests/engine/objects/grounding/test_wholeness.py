"""How whole a thing looks."""

from __future__ import annotations

import numpy as np

from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.wholeness import whole_odds
from tests.engine.objects.grounding.conftest import Room


def odds_of(detector: OfflineVocabulary, room: Room, mask: np.ndarray) -> float:
    rows, columns = np.nonzero(mask)
    box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    (odds,) = detector.whole_odds(detector.describe_crops(room.pixels, [box], [mask]))
    return float(odds)


def test_exhibits_look_more_whole_than_their_left_halves(detector: OfflineVocabulary, room: Room) -> None:
    gains = []
    for number in room.ids.values():
        whole = room.labels == number
        left = whole & (np.arange(whole.shape[1]) < np.median(np.nonzero(whole)[1]))
        gains.append(odds_of(detector, room, whole) - odds_of(detector, room, left))
    assert len(gains) > 5 and np.mean(np.array(gains) > 0) > 0.75
    assert np.mean(gains) > 0.5


def test_odds_do_not_depend_on_what_is_described_beside(detector: OfflineVocabulary, room: Room) -> None:
    masks = [room.labels == number for number in list(room.ids.values())[:3]]
    boxes = [[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1] for rows, columns in map(np.nonzero, masks)]
    together = detector.whole_odds(detector.describe_crops(room.pixels, boxes, masks))
    np.testing.assert_allclose(together, [odds_of(detector, room, mask) for mask in masks], atol=0.02)


def test_odds_are_linear_in_the_features() -> None:
    one, other = np.random.default_rng(0).uniform(0, 2, (2, 3, 2560)).astype(np.float32)
    np.testing.assert_allclose(whole_odds((one + other) / 2), (whole_odds(one) + whole_odds(other)) / 2, atol=1e-4)
    assert np.isfinite(whole_odds(one)).all() and len(np.unique(whole_odds(one))) == 3
