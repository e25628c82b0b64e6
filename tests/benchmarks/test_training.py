"""The table and the picture of training: means over seeds, gsplat beside."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from benchmarks.training.__main__ import main
from benchmarks.training.photo_sets import NAMES, photo_set
from benchmarks.training.running import Measured, TrainingBench
from benchmarks.training.table import presets_table
from engine.core.errors import SettingsError
from engine.core.files import write_json

CURVE = [{"cpu_seconds": seconds, "psnr": psnr} for seconds, psnr in ((10.0, 18.0), (100.0, 20.0))]
FIGURES = Measured(
    psnr=20.0, fitted_psnr=21.0, ssim=0.5, steps=3000, n_gaussians=40_000, wall_seconds=60.0, cpu_seconds=100.0,
    curve=CURVE,
)  # fmt: skip


def test_each_preset_has_its_means_beside_what_gsplat_reaches_on_the_set() -> None:
    text = presets_table(
        {
            ("banana16", "standard"): [FIGURES, replace(FIGURES, psnr=21.0)],
            ("room_1", "preview"): [FIGURES],
        }
    )
    assert "| banana16 | `standard` | 3,000 | 40,000 | 20.50 | 21.00 | 0.500 | 60 | 100 | 26.31 | 26.45 |" in text
    assert "| room_1 | `preview` | 3,000 | 40,000 | 20.00 | 21.00 | 0.500 | 60 | 100 |  |  |" in text


def test_sets_that_are_not_there_are_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingsError, match="no photo set 'garden', only herz_jesus25"):
        photo_set("garden")
    monkeypatch.setenv("GAUSSIAN_HERITAGE_DATA", str(tmp_path))
    with pytest.raises(SettingsError, match=r"photos of skull66 are not there\. Set GAUSSIAN_HERITAGE_DATA"):
        photo_set("skull66")
    assert photo_set("museum_room").photos.is_dir() and len(set(NAMES)) == len(NAMES)


def test_what_is_measured_so_far_makes_a_table_and_a_picture(tmp_path: Path) -> None:
    bench, document, picture = TrainingBench(tmp_path), tmp_path / "table.md", tmp_path / "picture.png"
    measured = (("museum_room", "preview", 19.0), ("museum_room", "standard", 20.0), ("store_room", "preview", 18.0))
    for name, preset, psnr in measured:
        folder = bench.folder(photo_set(name), preset, 0)
        write_json(folder / "measured.json", {"figures": asdict(replace(FIGURES, psnr=psnr))})
    document.write_text(
        "<!-- presets on the processor -->\n<!-- end of presets on the processor -->\n", encoding="utf-8"
    )
    # Without --measured-only, `standard` would be trained on the store room.
    files = ["--out", str(tmp_path), "--doc", str(document), "--picture", str(picture)]
    main(["--sets", "museum_room,store_room", "--measured-only", *files])
    rows = [line for line in document.read_text(encoding="utf-8").splitlines() if "_room" in line]
    begun = [f"| {name} | `{preset}` | 3,000 | 40,000 | {psnr:.2f} |" for name, preset, psnr in measured]
    assert len(rows) == len(begun) and all(row.startswith(one) for row, one in zip(rows, begun, strict=True))
    assert picture.read_bytes().startswith(b"\x89PNG")
