"""Measures the web server and its page, and writes a section of docs/web.md; ``make bench-serve`` calls it.

Timings depend on the machine, which the table names.

example: python -m benchmarks.serve --project out/museum_room/project --doc docs/web.md
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from engine.core.system import describe_machine

from ..documents import print_table
from .page import page_rows
from .server import Row, server_rows


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--project", type=Path, required=True, help="a project folder with a scene, which is copied")
    parser.add_argument("--doc", type=Path, required=True)
    options = parser.parse_args()
    parts = [
        f"Machine: {describe_machine().name}, shared with other work. Nothing was chosen by these figures.",
        table("server", server_rows()),
        table("page", page_rows(options.project)),
    ]
    print_table("\n\n".join(parts), options.doc, "serve")
    return 0


def table(what: str, rows: list[Row]) -> str:
    """Return a table in Markdown."""
    return "\n".join(
        [f"| {what} | measured | goal |", "| --- | --- | --- |", *(f"| {' | '.join(row)} |" for row in rows)]
    )


if __name__ == "__main__":
    sys.exit(main())
