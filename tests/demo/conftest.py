"""Imports of the demo's packages, which the scripts in demo/ find in their own folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="session", autouse=True)
def demo_on_path() -> Iterator[None]:
    folder = str(ROOT / "demo")
    sys.path.insert(0, folder)
    yield
    sys.path.remove(folder)
