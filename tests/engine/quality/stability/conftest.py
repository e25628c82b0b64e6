"""Fixtures that run the suite once for all tests that read its rows."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from engine.quality.stability.cases import CASES
from engine.quality.stability.table import Row, run_cases
from engine.quality.stability.training_cases import TRAINING_CASES
from engine.quality.stability.training_table import TrainingRow


@pytest.fixture(autouse=True)
def one_torch_thread() -> Iterator[None]:
    """Run torch with one thread. More would spin at barriers and change the order of the reference's sums."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def rows() -> dict[str, Row]:
    """Return the rows of all numerical cases by name."""
    results = run_cases(CASES, emit=lambda event: None, should_stop=lambda: False)
    return {row.case.name: row for row in results if isinstance(row, Row)}


@pytest.fixture(scope="session")
def training_rows() -> dict[str, TrainingRow]:
    """Return the rows of all training cases by name. Afterwards the PSNR of the undisturbed runs is cached."""
    results = run_cases(TRAINING_CASES, emit=lambda event: None, should_stop=lambda: False)
    return {row.case.name: row for row in results if isinstance(row, TrainingRow)}
