"""The commands of ``python -m engine``, one module each: name, help, example, arguments and `run`."""

from __future__ import annotations

from . import (
    batch,
    bench,
    doctor,
    edit,
    evaluate,
    export,
    frames,
    measure,
    models,
    plan,
    reconstruct,
    remote,
    render,
    report,
    segment,
    serve,
    stability,
    trash,
)
from .deprecated import warn_of_deprecated_options

__all__ = ["COMMANDS", "warn_of_deprecated_options"]

COMMANDS = (
    plan,
    frames,
    reconstruct,
    segment,
    edit,
    trash,
    measure,
    export,
    render,
    report,
    evaluate,
    bench,
    models,
    doctor,
    stability,
    serve,
    batch,
    remote,
)
