"""A step of the test on Windows' Python, and what the steps share."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .launch import Windows


@dataclass
class Context:
    """What the steps share.

    Attributes
    ----------
    product : Path
        The checkout that is tested.
    cache : Path
        As `launch.cache_folder`.
    keep : bool
        Whether the computers of an earlier run are used again.
    found : dict
        What a step leaves for later ones.
    """

    product: Path
    cache: Path
    keep: bool = False
    found: dict[str, Any] = field(default_factory=dict)

    @property
    def zip_file(self) -> Path:
        """The zip of the product, made by a step."""
        return self.cache / "gaussian_heritage.zip"

    def computer(self, name: str, **options: Any) -> Windows:
        """Return a Windows computer that only this test uses; a new one, unless it was asked for before in this run."""
        computer = Windows(self.cache, f"test-{name}", **options)
        if not self.keep and computer.folder not in self.found.setdefault("computers", set()):
            shutil.rmtree(computer.folder, ignore_errors=True)
        self.found.setdefault("computers", set()).add(computer.folder)
        computer.prepare()
        return computer


@dataclass(frozen=True)
class Step:
    """A step.

    Attributes
    ----------
    name : str
    run : callable
        Returns what was seen, as a sentence; raises `Problem` when that is not as it should be.
    needs : tuple of str
        Names of steps without which it cannot be run.
    """

    name: str
    run: Callable[[Context], str]
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Result:
    """How a step ended.

    Attributes
    ----------
    step : Step
    passed : bool
    text : str
        What was seen.
    """

    step: Step
    passed: bool
    text: str
