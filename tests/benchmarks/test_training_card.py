"""Trainings on a card are kept under the names of their runs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.training import card
from benchmarks.training.card import _file_name, run_name, run_settings
from engine.core.errors import SettingsError
from engine.core.system import usable_cores


def test_long_runs_have_file_names_of_their_own_that_file_systems_take() -> None:
    runs = [f"9000:300000:{':'.join(f'setting_{number}=0.123456' for number in range(12))}:last={end}" for end in "ab"]
    names = {_file_name(run) for run in runs}
    assert len(names) == 2 and all(len(name.encode()) < 200 for name in names)
    assert _file_name("3000:100000:dropout=0.1") == "3000_100000_dropout_0.1"


def test_preset_is_trained_as_a_plan_for_so_many_photos_has_it_on_a_card() -> None:
    views: Any = [SimpleNamespace(held_out=i % 8 == 4) for i in range(48)]
    standard = run_settings("standard:lr_means=8e-4", 3, views, "gpu")
    assert (standard.schedule.steps, standard.growth.max_gaussians, standard.growth.grow_interval) == (
        3_000,
        100_000,
        60,
    )
    assert (standard.optimiser.lr_means, standard.seed, standard.backend) == (8e-4, 3, "gpu")
    best = run_settings("best:rounds=100", 0, views, "gpu")
    assert (best.schedule.steps, best.growth.grow_interval, best.appearance.sh_interval) == (4_200, 84, 840)
    few: Any = views[:24]
    assert run_settings("best", 0, few, "gpu") == run_settings("standard", 0, few, "gpu")
    own = run_settings("2000:50000:dropout=0.1", 0, views, "cpu")
    assert (own.schedule.steps, own.growth.max_gaussians, own.loss.dropout) == (2_000, 50_000, 0.1)


def test_on_the_processor_a_preset_has_its_own_sizes_and_the_run_is_named_after_its_cores() -> None:
    views: Any = [SimpleNamespace(held_out=i % 8 == 4) for i in range(48)]
    standard = run_settings("standard", 0, views, "cpu")
    assert (standard.growth.max_gaussians, standard.appearance.sh_degree, standard.backend) == (40_000, 1, "cpu")
    assert run_name("standard", "cpu") == f"{len(usable_cores())} cores:standard"
    assert run_name("standard", "gpu") == "standard"


def test_rooms_whose_true_views_are_there_are_not_rendered_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpacked: list[str] = []

    def refuses(name: str, folder: Path) -> None:
        unpacked.append(folder.name)
        raise SettingsError("unpacked")

    monkeypatch.setattr(card, "unpack_kept", refuses)
    (tmp_path / "true").mkdir()
    (tmp_path / "true" / "room_3.npz").touch()
    with pytest.raises(SystemExit, match="unpacked"):
        card.main(["prepare-rooms", "--rooms", "3,6", "--out", str(tmp_path)])
    assert unpacked == ["room_6"]
