"""Rows of sparse matrices in blocks, for threads: what is done to a row has the bits that it has in one thread."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from scipy.sparse import csr_matrix

RowBlock = tuple[slice, *tuple[csr_matrix, ...]]
"""Rows of matrices of as many rows, and each matrix with these rows alone."""


def row_blocks(matrices: tuple[csr_matrix, ...], count: int) -> list[RowBlock]:
    """Return `count` blocks of the rows of matrices, of nearly as many links each; links are not copied."""
    links = sum(matrix.indptr.astype(np.int64) for matrix in matrices)
    edges = np.searchsorted(links, np.linspace(0, links[-1], count + 1)[1:-1]).tolist()
    return [
        (slice(first, end), *(_rows(matrix, first, end) for matrix in matrices))
        for first, end in itertools.pairwise([0, *edges, len(links) - 1])
    ]


def _rows(matrix: csr_matrix, first: int, end: int) -> csr_matrix:
    start, stop = matrix.indptr[first], matrix.indptr[end]
    rows = csr_matrix((end - first, matrix.shape[1]), dtype=matrix.dtype)
    # Given to `csr_matrix` itself, a small part of a large array is copied.
    rows.data, rows.indices = matrix.data[start:stop], matrix.indices[start:stop]
    rows.indptr = matrix.indptr[first : end + 1] - start
    return rows


def on_each(work: Callable[..., None], blocks: Sequence[RowBlock], threads: Executor | None) -> None:
    """Do some work on each block, in threads where there are some."""
    for _ in itertools.starmap(work, blocks) if threads is None else threads.map(lambda block: work(*block), blocks):
        pass
