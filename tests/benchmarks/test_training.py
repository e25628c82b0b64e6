"""The tables of training variants: means over seeds, changes against the first variant, and refused set names."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from benchmarks.training.photo_sets import NAMES, photo_set
from benchmarks.training.running import Measured, TrainingBench
from benchmarks.training.table import details, overview
from benchmarks.training.variants import VARIANTS
from engine.core.errors import SettingsError
from engine.core.files import write_json
from engine.training.settings import PRESETS

ROOT = Path(__file__).resolve().parents[2]
FIGURES = Measured(
    psnr=20.0, fitted_psnr=21.0, well_seen_psnr=22.0, ssim=0.5, l1=0.1, flip=0.2, well_seen_share=0.8, dark_share=0.01,
    dark_share_trained=0.002, trained_psnr=25.0, steps=3000, n_gaussians=40_000, cpu_seconds=100.0, iou=None,
)  # fmt: skip


def test_overview_tells_mean_changes_over_the_sets_that_both_variants_have() -> None:
    results = {
        ("banana16", "as-planned"): [FIGURES, replace(FIGURES, psnr=21.0)],
        ("banana16", "detached"): [replace(FIGURES, psnr=22.0)],
        ("skull66", "as-planned"): [FIGURES],
    }
    text = overview(results)
    assert "| as-planned | 20.50 (21.00) | 20.00 (21.00) |  |" in text
    assert "| detached | 22.00 (21.00) |  | +1.50 (+0.00) |" in text
    assert "| commit 06f55961, as planned | 24.80 | 25.13 | |" in text
    assert "| gsplat, 3,000 steps | 26.31 (26.45) | 23.86 (25.16) | |" in text


def test_details_tell_every_figure_and_leave_out_what_was_not_measured() -> None:
    text = details({("banana16", "detached"): [FIGURES, replace(FIGURES, iou=80.0, well_seen_psnr=None)]})
    assert "| banana16 | detached | 2 | 3,000 | 20.00 | 21.00 | 22.00 (80%) | 25.00 |" in text
    assert "| 1.00 | 0.20 | 80.0 | 100 |" in text


def test_sets_that_are_not_there_are_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingsError, match="no photo set 'garden', only herz_jesus25"):
        photo_set("garden")
    monkeypatch.setenv("GAUSSIAN_HERITAGE_DATA", str(tmp_path))
    with pytest.raises(SettingsError, match=r"photos of skull66 are not there\. Set GAUSSIAN_HERITAGE_DATA"):
        photo_set("skull66")
    assert photo_set("museum_room").photos.is_dir() and len(set(NAMES)) == len(NAMES)


def test_two_sets_at_a_time_make_one_table_without_repeating_what_is_measured(tmp_path: Path) -> None:
    bench = TrainingBench(tmp_path, preset="standard", objects=False)
    for name in ("museum_room", "store_room"):
        folder = bench.folder(photo_set(name), VARIANTS["no-features"], 0)
        write_json(folder / "measured.json", {"figures": asdict(FIGURES)})
    command = [sys.executable, "-m", "benchmarks.training", "--sets", "museum_room,store_room", "--jobs", "2"]
    command += ["--variants", "no-features", "--out", str(tmp_path), "--doc", str(tmp_path / "table.md")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "| no-features | 20.00 (21.00) | 20.00 (21.00) |" in (tmp_path / "table.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(VARIANTS))
def test_every_variant_is_a_change_that_the_settings_know(name: str) -> None:
    PRESETS["standard"].changed(**VARIANTS[name].changes)
