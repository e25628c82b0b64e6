"""The generated parts of documents."""

from __future__ import annotations

import re
import sys
from pathlib import Path


def put_into(document: Path, part: str, text: str) -> None:
    """Replace what stands between the marks of a part."""
    before = document.read_text(encoding="utf-8")
    begin, end = f"<!-- {part} -->", f"<!-- end of {part} -->"
    after, count = re.subn(f"{begin}.*?{end}", lambda _: f"{begin}\n{text}\n{end}", before, flags=re.DOTALL)
    if count != 1:
        raise ValueError(f"{document} has no {begin} ... {end}")
    document.write_text(after, encoding="utf-8")


def print_table(table: str, document: Path | None, part: str, mark: str = "") -> None:
    """Print a table, and write it below `mark`, if any, between the marks of a part of `document`, if there is one."""
    sys.stdout.write(table.rstrip("\n") + "\n")
    if document is not None:
        put_into(document, part, f"{mark}\n\n{table}" if mark else table)
