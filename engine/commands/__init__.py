"""One module per command of ``python -m engine``: its name, help, example, arguments and what it runs."""

from __future__ import annotations

from . import doctor, export, models, reconstruct, render, report, segment, stability

__all__ = ["COMMANDS"]

COMMANDS = (reconstruct, segment, export, render, report, models, doctor, stability)
