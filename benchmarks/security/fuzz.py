"""Read damaged inputs with every reader of the product: ``make fuzz FUZZ_S=600``. Linux only.

An input that ends in an error that is not ours, or takes too much time or memory, is kept in tests/fixtures/damaged,
where `make test` reads it again.

example: python -m benchmarks.security.fuzz --seconds 600 --doc docs/security_fuzz.md
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from engine import __version__

from ..documents import print_table
from .fuzz_inputs import Workplace, keep
from .fuzz_worker import MAX_SECONDS, Measured, serve
from .reader import ROOT, Reader
from .readers import READERS

CORPUS = ROOT / "tests" / "fixtures" / "damaged"
_MAX_WALL_SECONDS = 150.0
"""An input that takes longer without using the processor hangs."""
_MAX_KEPT_BYTES = 30_000


@dataclass
class Row:
    """What was measured of one reader."""

    reader: Reader
    kinds: collections.Counter[str] = field(default_factory=collections.Counter)
    seconds: float = 0.0
    n_bytes: int = 0
    problems: dict[str, int] = field(default_factory=dict)
    """The number of the first input of each error."""

    def add(self, one: Measured) -> None:
        """Count one input."""
        self.kinds[one.kind] += 1
        self.seconds, self.n_bytes = max(self.seconds, one.seconds), max(self.n_bytes, one.n_bytes)
        if one.error:
            # Without the numbers in the message, which differ between inputs.
            self.problems.setdefault(one.error.partition(": ")[0] if one.kind == "other" else one.error, one.number)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz the readers and write the table; return 1 when a problem was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.security.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="wall time for all readers (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the damage (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="readers at the same time (default: %(default)s)")
    parser.add_argument("--only", default="", help="readers whose names begin with this")
    parser.add_argument("--doc", type=Path, help="put the table between the marks of this document")
    options = parser.parse_args(arguments)
    if sys.platform != "linux":
        parser.error("memory is measured on Linux only")
    # Freed memory goes back to the system, so that the peak of the next input is its own.
    os.environ |= {"MALLOC_MMAP_THRESHOLD_": "131072", "MALLOC_TRIM_THRESHOLD_": "131072"}
    rows = [Row(reader) for reader in READERS if reader.name.startswith(options.only)]
    share = options.seconds * options.workers / sum(row.reader.share for row in rows)

    def run(row: Row) -> None:
        try:
            _run(row, options.seed, share * row.reader.share)
        except RuntimeError as failure:
            # The other readers are still worth reading.
            row.problems[str(failure).strip().splitlines()[-1]] = -1
        count = sum(row.kinds.values())
        print(f"{row.reader.name}: {count} inputs, {row.kinds['other']} other errors", file=sys.stderr, flush=True)
        for error, number in row.problems.items():
            print(f"  input {number}: {error}{_kept(row.reader, options.seed, number)}", file=sys.stderr, flush=True)

    with ThreadPoolExecutor(options.workers) as pool:
        list(pool.map(run, rows))
    print_table(_table(rows, options.seed, options.seconds), options.doc, "fuzz")
    return int(any(row.problems for row in rows))


def _run(row: Row, seed: int, seconds: float) -> None:
    """Read inputs in a process, and in another one when that dies."""
    context = multiprocessing.get_context("spawn")
    deadline, number = time.monotonic() + seconds, 0
    while number == 0 or time.monotonic() < deadline:
        with tempfile.TemporaryDirectory(prefix="heritage-fuzz-") as folder:
            receiving, sending = context.Pipe(duplex=False)
            left = deadline - time.monotonic()
            process = context.Process(
                target=serve, args=(row.reader.name, seed, number, left, f"{folder}/input", sending), daemon=False
            )
            process.start()
            sending.close()
            number, has_ended = _collect(row, receiving, number)
            if not has_ended:
                process.kill()
            process.join()
        if process.exitcode == 0:
            return
        row.add(Measured(number, "other", _death(process.exitcode or 0), MAX_SECONDS, 0))
        number += 1


def _collect(row: Row, receiving: Connection, number: int) -> tuple[int, bool]:
    """Count what a process sends; return the number of the input that it did not finish, and whether it has ended."""
    try:
        while receiving.poll(_MAX_WALL_SECONDS):
            one: Measured | str = receiving.recv()
            if isinstance(one, str):
                raise RuntimeError(one)
            row.add(one)
            number = one.number + 1
    except EOFError:
        return number, True
    return number, False


def _death(code: int) -> str:
    if code == -signal.SIGPROF:
        return f"it took more than {MAX_SECONDS:.0f} s"
    if code == -signal.SIGKILL:
        return "it hangs, or took all memory"
    return f"the process ended with code {code}"


def _kept(reader: Reader, seed: int, number: int) -> str:
    """Keep the damaged file of an input, and return where for the message."""
    if number < 0:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        workplace = Workplace(reader, Path(folder, "input"))
        name = workplace.damage(seed, number)
        path = workplace.folder / name
        if not path.is_file() or path.stat().st_size > _MAX_KEPT_BYTES:
            return ""
        return f" ({keep(CORPUS, reader, name, path.read_bytes()).relative_to(ROOT)})"


def _table(rows: Sequence[Row], seed: int, seconds: float) -> str:
    total: collections.Counter[str] = sum((row.kinds for row in rows), collections.Counter())
    n_problems = sum(len(row.problems) for row in rows)
    lines = [
        f"Made by `make fuzz FUZZ_S={seconds:.0f}` with the seed {seed}. Code: version {__version__}.",
        "",
        f"Together: {_count(sum(total.values()))} inputs to {len(rows)} readers, {_count(total['accepted'])} accepted, "
        f"{_count(total['refused'])} refused, **{_count(total['other'])} other errors**. "
        f"{n_problems} distinct problems.",
        "",
        "| reader | inputs | accepted | refused | other errors | slowest | memory |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in sorted(rows, key=lambda row: row.reader.name):
        counts = (sum(row.kinds.values()), *(row.kinds[kind] for kind in ("accepted", "refused", "other")))
        cells = [row.reader.name, *map(_count, counts), f"{row.seconds:.2f}", f"{row.n_bytes / 1e6:.0f}"]
        lines.append(f"| {' | '.join(cells)} |")
    found = [f"- {row.reader.name}, input {number}: {error}" for row in rows for error, number in row.problems.items()]
    if found:
        lines += ["", "## Problems", "", *found]
    return "\n".join(lines)


def _count(number: int) -> str:
    return f"{number:,}"


if __name__ == "__main__":
    sys.exit(main())
