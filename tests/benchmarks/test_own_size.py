"""The table of details at the photos' own size says of every object what it gained, and how many lost."""

from __future__ import annotations

from benchmarks.own_size import Figures, table


def figures(name: str, gain: float) -> Figures:
    return Figures(
        f"a set | {name}", (4032, 3024), 3, psnr=(20.0, 20.0 + gain), sharp=(13.0, 31.0), needles=(32.0, 0.0),
        n_gaussians=(1000, 6000), scale=0.37, cpu_seconds=100.0, memory=2.0,
    )  # fmt: skip


def test_objects_that_lose_are_counted() -> None:
    text = table([figures("vase", 3.0), figures("mask", -0.4), figures("drum", 0.04)])
    # The drum gains 0.04 dB, which the table does not show.
    assert text.endswith("The PSNR rises for 1 and falls for 1 of 3 objects.")
    rows = {row.split("|")[2].strip(): row for row in text.splitlines()[2:-2]}
    assert list(rows) == ["vase", "mask", "drum", ""]
    assert "| 20.0 | 23.0 | +3.0 | 13 | 31 | 32 | 0 | 1,000 | 6,000 | 0.37 |" in rows["vase"]
    assert "| **mean** | | | | 20.0 | 20.9 | +0.9 | 13 | 31 |" in rows[""]
    assert {row.count("|") for row in text.splitlines()[:-2]} == {17}
