"""One module per command of ``python -m engine``: its name, help, example, arguments and what it runs."""

from __future__ import annotations

from . import bench, doctor, evaluate, export, models, plan, reconstruct, render, report, segment, stability

__all__ = ["COMMANDS"]

COMMANDS = (plan, reconstruct, segment, export, render, report, evaluate, bench, models, doctor, stability)
