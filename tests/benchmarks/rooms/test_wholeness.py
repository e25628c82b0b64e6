"""The fit of how whole things look."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from benchmarks.rooms import wholeness
from benchmarks.rooms.wholeness import Measured, fit, log_loss


def made_up_rooms(count: int, strength: float) -> list[Measured]:
    """Return rooms whose proposals are objects by the odds of the set and, with `strength`, by one feature."""
    random = np.random.default_rng(5)
    rooms = []
    for _ in range(count):
        odds = random.normal(0, 1, 80).astype(np.float32)
        features = random.uniform(0, 2, (80, 2560)).astype(np.float32)
        truth = expit(odds - 1 + strength * (features[:, 7] - 1))
        rooms.append(Measured(odds, features, (random.uniform(size=80) < truth).astype(np.float32)))
    return rooms


def test_features_that_tell_help_in_a_room_left_out_and_noise_does_not_harm_much() -> None:
    for strength, least_gain in ((6.0, 0.08), (0.0, -0.06)):
        *rooms, left_out = made_up_rooms(12, strength)
        mean = np.mean(np.concatenate([room.iou for room in rooms]))
        constant = log_loss(left_out, float(np.log(mean / (1 - mean))), np.zeros(2560))
        bias, weights = fit(rooms)
        assert constant - log_loss(left_out, bias, weights) > least_gain
        assert strength == 0 or np.argmax(np.abs(weights)) == 7


def test_few_rooms_change_weights_that_are_near_to_theirs_only_where_they_say_otherwise() -> None:
    *many, left_out = made_up_rooms(12, 6.0)
    before = fit(many)
    alone, near = fit(many[:1]), fit(many[:1], before)
    assert log_loss(left_out, *near) < log_loss(left_out, *alone)
    assert abs(log_loss(left_out, *near) - log_loss(left_out, *before)) < 0.05


def test_families_of_rooms_weigh_the_same_however_many_rooms_each_has() -> None:
    (room,) = made_up_rooms(1, 0.0)
    objects = replace(room, odds=np.zeros_like(room.odds), iou=np.ones_like(room.iou))
    none = replace(objects, iou=np.zeros_like(room.iou), family="models")
    bias, weights = fit([objects, objects, objects, none])
    # Nothing tells the families apart, so that each has half of the say. By rooms, it would be three quarters.
    np.testing.assert_allclose(expit(room.features @ weights + bias), 0.5, atol=0.01)


def test_weights_are_written_as_the_detector_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rooms = made_up_rooms(3, 6.0)
    monkeypatch.setattr(wholeness, "measure", lambda path: rooms[int(path.name)])
    out = tmp_path / "weights.txt"
    assert wholeness.main(["0", "1", "2", "--out", str(out)]) == 0
    assert "rooms left out" in capsys.readouterr().out
    monkeypatch.setattr("engine.objects.grounding.wholeness.WEIGHTS_FILE", out)
    from engine.objects.grounding.wholeness import _fit, whole_odds

    _fit.cache_clear()
    bias, weights = fit(rooms)
    np.testing.assert_allclose(whole_odds(rooms[0].features), rooms[0].features @ weights + bias, atol=0.01)
    _fit.cache_clear()
