"""`python -m engine stability` prints and writes the table, and its exit code is 1 if a row is red."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.cli.main import main
from engine.quality.stability import cases, table


def test_one_case_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "folder" / "table.md"
    assert main(["stability", "--case", "needle_1e6", "--out", str(out)]) == 0
    written = out.read_text(encoding="utf-8")
    assert "| `needle_1e6` |" in written and "1 cases, 0 red" in written
    assert "| `needle_1e6` |" in "".join(capsys.readouterr())


def test_a_red_row_makes_the_exit_code_1(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wrong = cases.Case("wrong", "expected otherwise", "culled", cases.CASES[0].run)
    monkeypatch.setattr(table, "CASES", (wrong,))
    monkeypatch.setattr(table, "TRAINING_CASES", ())
    assert main(["stability", "--out", str(tmp_path / "table.md")]) == 1
    text = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "**red**" in text and "- `wrong`: unexpected outcome" in text


def test_a_case_of_training_is_run_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stability", "--case", "start_means_nan"]) == 0
    output = "".join(capsys.readouterr())
    assert "| `start_means_nan` |" in output and "to start from is not finite" in output
    assert "float64" not in output


def test_an_unknown_case_gives_an_error_with_the_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stability", "--case", "needles", "--events"]) == 2
    assert "There is no case 'needles'" in capsys.readouterr().out


def test_the_same_case_gives_the_same_figures_again() -> None:
    first, second = (table.run_case(table.select_cases("scale_1e+1")[0]) for _ in range(2))
    assert first.finding == second.finding
