"""The table of whole steps on a card names gsplat's time where it was measured."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.gpu_document import _step_tables


def test_steps_stand_beside_those_of_gsplat_where_they_were_measured(tmp_path: Path) -> None:
    ours = {"card": "Card", "cases": {"RGB": {"step": 4.0, "MB": 600.0}, "RGB+16": {"step": 5.0, "MB": 900.0}}}
    (tmp_path / "step_1000000.json").write_text(json.dumps(ours))
    assert _step_tables(tmp_path)[2:5] == ["| step | step | MB |", "| --- | --- | --- |", "| RGB | 4.0 | 600.0 |"]
    theirs = {"card": "Card", "ssim": "torch's", "cases": {"RGB": {"step": 6.0, "MB": 1.0, "features": ""}}}
    (tmp_path / "gsplat_step_1000000.json").write_text(json.dumps(theirs))
    lines = _step_tables(tmp_path)
    assert "with torch's SSIM" in lines[0] and lines[2] == "| step | step | gsplat | gsplat / ours | MB |"
    assert lines[4:6] == ["| RGB | 4.0 | 6.0 | 1.50 | 600.0 |", "| RGB+16 | 5.0 | - | - | 900.0 |"]
