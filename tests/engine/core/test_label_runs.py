"""Label maps as runs are the same maps, in a small part of the memory."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.label_runs import LabelRuns


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (31, 47), (0, 5)])
@pytest.mark.parametrize("n_labels", [1, 3, 1 << 20])
def test_runs_are_the_label_map(shape: tuple[int, int], n_labels: int) -> None:
    labels = np.random.default_rng(0).integers(0, n_labels, shape, dtype=np.int32)
    again = LabelRuns.of(labels).array()
    assert again.dtype == np.int32 and np.array_equal(again, labels)


def test_runs_of_segments_take_a_small_part_of_the_memory() -> None:
    y, x = np.mgrid[:768, :1024]
    # Some 80 segments, whose borders are not along the rows.
    labels = ((x + y) // 128 + 16 * ((x - y) // 128 + 8)).astype(np.int32)
    runs = LabelRuns.of(labels)
    # 8 bytes for each run, and 16 runs in a row, against 4 bytes for each of 1,024 pixels: a 30th.
    assert runs.nbytes < labels.nbytes / 25 and np.array_equal(runs.array(), labels)
