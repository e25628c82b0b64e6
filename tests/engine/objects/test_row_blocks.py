"""Blocks of rows have the rows of their matrices, whose links are not copied."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix, random_array

from engine.objects.row_blocks import row_blocks


@pytest.mark.parametrize("count", [1, 3, 16])
def test_blocks_share_the_links_of_their_matrices(count: int) -> None:
    first, second = (
        csr_matrix(random_array((500, width), density=0.05, rng=width, dtype=np.float32)) for width in (500, 40)
    )
    vector = np.arange(500, dtype=np.float32)
    blocks = row_blocks((first, second), count)
    assert len(blocks) == count
    for rows, of_first, of_second in blocks:
        assert np.shares_memory(of_first.data, first.data) and np.shares_memory(of_first.indices, first.indices)
        assert np.shares_memory(of_second.data, second.data) and np.shares_memory(of_second.indices, second.indices)
        assert np.array_equal(of_first.toarray(), first[rows].toarray())
        assert np.array_equal(of_first @ vector, (first @ vector)[rows])
        assert np.array_equal(of_second.toarray(), second[rows].toarray())
        of_first.check_format(full_check=True)
    assert [rows.start for rows, *_ in blocks] == [0, *(rows.stop for rows, *_ in blocks[:-1])]
    assert blocks[-1][0].stop == 500
