"""The suite is run once for all tests that read its rows."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from engine.stability.cases import CASES
from engine.stability.table import Row, run_cases


@pytest.fixture(autouse=True)
def one_torch_thread() -> Iterator[None]:
    """Torch's own threads would spin at barriers and change the order of the reference's sums."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def rows() -> dict[str, Row]:
    """Every case, by name."""
    return {row.case.name: row for row in run_cases(CASES, emit=lambda event: None, should_stop=lambda: False)}
