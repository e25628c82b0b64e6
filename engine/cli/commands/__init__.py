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
    package,
    plan,
    reconstruct,
    remote,
    render,
    report,
    segment,
    serve,
    show_clicks,
    stability,
    trash,
    turntable,
    verify,
)

__all__ = ["COMMANDS"]

COMMANDS = (
    plan,
    frames,
    reconstruct,
    segment,
    show_clicks,
    edit,
    trash,
    measure,
    export,
    package,
    verify,
    turntable,
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
