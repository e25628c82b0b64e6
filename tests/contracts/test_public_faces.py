"""A package's public names can be imported from it, whatever was imported before."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts[1:])
    for pattern in ("*/__init__.py", "*/*/__init__.py")
    for path in (ROOT / "engine").glob(pattern)
    if "__all__" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_can_be_imported(name: str) -> None:
    package = importlib.import_module(f"engine.{name}")
    for public in package.__all__:
        assert getattr(package, public) is not None
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        package.nothing_of_this_name  # noqa: B018


@pytest.mark.parametrize("name", PACKAGES)
def test_no_public_name_is_that_of_a_module(name: str) -> None:
    """``from ..training import train`` would give the module ``train`` once anybody had imported it."""
    package = importlib.import_module(f"engine.{name}")
    modules = {path.stem for path in (ROOT / "engine" / name.replace(".", "/")).glob("*.py")}
    modules |= {path.parent.name for path in (ROOT / "engine" / name.replace(".", "/")).glob("*/__init__.py")}
    assert set(package.__all__) & modules == set()
