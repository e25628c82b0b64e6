"""The table of one project on several workers compares what was measured alike."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.batch.split import split_table


def test_table_has_the_rows_of_equal_workers_and_tells_bits_only_where_some_were_compared(tmp_path: Path) -> None:
    def measured(workers: int, **more: object) -> None:
        row = {"workers": workers, "machine": "a computer", **more}
        (tmp_path / "split" / f"{workers}.json").write_text(json.dumps(row), encoding="utf-8")

    (tmp_path / "split").mkdir()
    measured(1, matching={"seconds": 8.0, "sha256": "a"})
    measured(2, cores_each=1, matching={"seconds": 4.0, "sha256": "a"})
    measured(3, matching={"seconds": 4.0, "sha256": "b"})
    measured(4, masks={"seconds": 4.0, "sha256": "b"})
    measured(5, cores_each=2, matching={"seconds": 2.0, "sha256": "a"})
    rows = [line for line in split_table(tmp_path).splitlines() if line[:3] in {f"| {one}" for one in range(1, 6)}]
    assert [row.split(" | ")[0] for row in rows] == ["| 1", "| 2", "| 3", "| 4"]
    assert rows[1].startswith("| 2 | 4.0 | 2.00 |") and rows[1].endswith("| those of one |")
    assert rows[2].endswith("| others |") and rows[3].endswith("|  |")
