"""Mixtures of photo folders, cameras and prompts: read as their truth says, and faults are seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.mixtures import cases
from benchmarks.mixtures.__main__ import table_of
from benchmarks.mixtures.cases import WRONG, Outcome, run_case


@pytest.mark.parametrize("seed", range(3))
def test_mixtures_are_read_as_their_truth_says(seed: int, tmp_path: Path) -> None:
    outcome = run_case(seed, tmp_path)
    assert outcome.result != WRONG, outcome.sentences


def test_photos_that_are_decoded_wrongly_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = cases.load_pixels

    def upside_down(path: Path) -> Any:
        return np.ascontiguousarray(load(path)[::-1])

    monkeypatch.setattr(cases, "load_pixels", upside_down)
    outcome = run_case(0, tmp_path)
    assert outcome.result == WRONG
    assert "is decoded wrongly" in " ".join(outcome.sentences)


def test_prompts_that_lose_a_text_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "split_texts", lambda prompt: [prompt])
    outcome = run_case(0, tmp_path)
    assert outcome.result == WRONG
    assert "the prompt" in " ".join(outcome.sentences)


def test_the_table_names_the_seeds_of_wrong_cases() -> None:
    table = table_of([Outcome(7, WRONG, frozenset({"zoom"}), ("a",)), Outcome(8, "right", frozenset({"zoom"}), ())])
    assert "| 2 | 1 | 0 | 1 |" in table and "`zoom` 2 (1 wrong)" in table
    assert table.endswith("Seeds of silently wrong cases: 7.")
