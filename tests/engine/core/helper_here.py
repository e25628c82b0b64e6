"""A helper that calls its shares in the process of the test, with JSON values as between computers."""

from __future__ import annotations

import importlib
import json
from collections.abc import Sequence
from typing import Any

from engine.core.shares import Arguments, Need


class _Called:
    finished = True

    def __init__(self, results: list[Any]) -> None:
        self._results = results

    def results(self) -> list[Any]:
        return self._results

    def end(self) -> None:
        """Nothing runs."""


class HelperHere:
    """All helpers of an engine: one computer that is always free and calls one share at a time."""

    def __init__(self) -> None:
        self.shares: list[Arguments] = []

    def free(self) -> Sequence[HelperHere]:
        return [self]

    def places(self, need: Need) -> int:
        return 1

    def begin(self, function: str, shares: Sequence[Arguments], need: Need, *, what: str) -> _Called:
        self.shares += shares
        module, _, name = function.partition(":")
        called = getattr(importlib.import_module(f"engine.{module}"), name)
        return _Called([json.loads(json.dumps(called(**json.loads(json.dumps(one))))) for one in shares])
