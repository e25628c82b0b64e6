"""Trainings on a card are kept under the names of their runs."""

from __future__ import annotations

from benchmarks.training.card import _file_name


def test_long_runs_have_file_names_of_their_own_that_file_systems_take() -> None:
    runs = [f"9000:300000:{':'.join(f'setting_{number}=0.123456' for number in range(12))}:last={end}" for end in "ab"]
    names = {_file_name(run) for run in runs}
    assert len(names) == 2 and all(len(name.encode()) < 200 for name in names)
    assert _file_name("3000:100000:dropout=0.1") == "3000_100000_dropout_0.1"
