"""A helper that calls functions in the process of the test, with JSON values as between computers."""

from __future__ import annotations

import importlib
import json
from collections.abc import Sequence
from typing import Any

from engine.core.shares import Need


class _Ended:
    works = False

    def end(self) -> None:
        """Nothing runs."""


class HelperHere:
    """All helpers of an engine: one computer, free until it is called, which then takes all items that are left."""

    def __init__(self) -> None:
        self.called: list[str] = []

    def free(self) -> Sequence[HelperHere]:
        return [] if self.called else [self]

    def places(self, need: Need) -> int:
        return 1

    def begin(self, function: str, arguments: dict[str, Any], count: int, need: Need, *, what: str) -> _Ended:
        self.called.append(function)
        module, _, name = function.partition(":")
        getattr(importlib.import_module(f"engine.{module}"), name)(**json.loads(json.dumps(arguments)))
        return _Ended()
