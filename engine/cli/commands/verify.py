"""``verify``: say what changed in a package since it was made."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import FormatError
from ...core.events import Emit, Finished, StopCheck, Warned

NAME = "verify"
HELP = "Compare the files of a package (BagIt, a folder or a zip file) with their checksums, and say what changed."
EXAMPLE = "python -m engine verify packages/vase"
_MAX_NAMED = 100
"""Files that are named one by one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("package", type=Path, help="folder or zip file made by `package`, or any other BagIt package")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Verify, and name what changed; the exit code is 0 only if nothing did."""
    from ...delivery.packages import verify_package

    found = verify_package(options.package, should_stop=should_stop)
    figures = {
        "changed": list(found.changed),
        "missing": list(found.missing),
        "added": list(found.added),
        "n_files": found.n_files,
        "n_bytes": found.n_bytes,
    }
    problems = [
        f"{name} {what}." for what, names in _named(found.changed, found.missing, found.added) for name in names
    ]
    for problem in problems[:_MAX_NAMED]:
        emit(Warned(problem))
    if not found.is_intact:
        counts = (
            f"{len(names)} {word}"
            for word, names in (("changed", found.changed), ("missing", found.missing), ("added", found.added))
            if names
        )
        raise FormatError(f"{options.package} is not as it was made: {', '.join(counts)}. Use another copy.")
    made = found.info.get("Bagging-Date")
    since = f" since {made}" if made else ""
    size = f"{found.n_files} files, {found.n_bytes / 1e6:.1f} MB"
    emit(Finished(f"Nothing changed in {options.package}{since}: {size}.", figures))
    return 0


def _named(
    changed: tuple[str, ...], missing: tuple[str, ...], added: tuple[str, ...]
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    return ("was changed", changed), ("is missing", missing), ("was added", added)
