"""The report on detail says for every exhibit whether detail helped it."""

from __future__ import annotations

from benchmarks.detail import Figures, summary, table_of_exhibits


def figures(psnr: float, *, beyond: float = 5.0, shines_through: float = 2.0) -> Figures:
    return Figures(beyond, missing=1.0, shines_through=shines_through, psnr=psnr, sharp=80.0, needles=3.0, seconds=41.7)


BEFORE = {"vase": figures(27.0), "mask": figures(26.0), "drum": figures(27.4), "bell": figures(30.0)}
AFTER = {
    "vase": figures(27.04, shines_through=1.0),
    "mask": figures(28.0, beyond=4.0),
    "drum": figures(26.6, beyond=6.0),
    "bell": figures(29.9, beyond=4.0, shines_through=1.0),
}


def test_exhibits_that_lose_are_counted_and_the_worst_is_named() -> None:
    text = summary(BEFORE, AFTER)
    # The vase gains 0.04 dB, which the table does not show.
    assert "rises for 1 and falls for 2 of 4 exhibits" in text
    assert "-0.8 dB (drum)" in text and "+2.0 dB (mask)" in text
    assert "shines through 2 of them, and 2 reach less beyond" in text


def test_each_exhibit_has_its_own_row_with_the_change_and_the_mean_is_the_last() -> None:
    rows = {row.split("|")[1].strip(): row for row in table_of_exhibits(BEFORE, AFTER).splitlines()[2:]}
    assert list(rows) == [*BEFORE, "**mean**"]
    assert "| 27.4 | 26.6 | -0.8 |" in rows["drum"] and "| +2.0 |" in rows["mask"]
    assert rows["**mean**"].startswith(
        "| **mean** | 5.0 | 4.8 | 1.0 | 1.0 | 2.0 | 1.5 | 80 | 80 | 3 | 3 | 27.6 | 27.9 |"
    )
    header, rule = table_of_exhibits(BEFORE, AFTER).splitlines()[:2]
    assert header.count("|") == rule.count("|") == rows["drum"].count("|")
