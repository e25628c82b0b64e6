"""Kill the engine at random moments of every stage and command, continue, and compare: ``make kills``.

example: python -m benchmarks.security.kills --trials 200 --doc docs/security_kills.md
"""

from __future__ import annotations

import argparse
import collections
import os
import platform
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from engine.core.system import cpu_seconds, describe_machine
from engine.pipeline.planning.benchmark import calibrate

from ..documents import print_table
from .kills_engine import shorten_stages
from .kills_fixture import KINDS, Fixture, Kind
from .kills_trial import MAX_STOP_SECONDS, Trial

_ALL = 200
Item = TypeVar("Item")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and write the table; return 1 when one of them found a problem."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.security.kills", description=__doc__)
    parser.add_argument("--trials", type=int, default=_ALL, help="number of kills (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the random moments (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="trials at the same time (default: %(default)s)")
    parser.add_argument("--only", default="", help="kinds whose names begin with this")
    parser.add_argument("--doc", type=Path, help="put the table between the marks of this document")
    options = parser.parse_args(arguments)
    begin = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="heritage-kills-"))
    kinds = [kind for kind in KINDS if kind.name.startswith(options.only)]
    trials = plan_trials(kinds, options.trials, options.seed)
    fixture = Fixture(folder)
    os.environ["GAUSSIAN_HERITAGE_CALIBRATION"] = str(fixture.calibration)
    shorten_stages()
    calibrate(describe_machine(), emit=lambda event: None)
    fixture.make_states()
    _say(begin, "the states are ready")
    used = [kind for kind in kinds if any(trial.kind is kind for trial in trials)]
    _in_parallel(fixture.make_reference, used, options.workers)
    _say(begin, f"uninterrupted runs are measured; {len(trials)} trials")

    def run(numbered: tuple[int, Trial]) -> None:
        number, trial = numbered
        trial.run(fixture, folder / "trials" / str(number))
        _say(begin, f"{number + 1:3} {trial.kind.name}: {trial.moment}{'; '.join(trial.problems) or 'as it was'}")

    # Long and short trials are mixed, so that no worker waits for the other at the end.
    _in_parallel(run, list(enumerate(trials)), options.workers)
    minutes = (time.monotonic() - begin) / 60
    print_table(table(trials, minutes, options.workers, options.seed), options.doc, "kills")
    failed = [trial for trial in trials if trial.problems]
    if failed:
        print(f"{len(failed)} trials found a problem; their folders are kept in {folder}.", file=sys.stderr)
    else:
        shutil.rmtree(folder)
    return int(bool(failed))


def plan_trials(kinds: Sequence[Kind], count: int, seed: int) -> list[Trial]:
    """Return `count` trials, spread over `kinds` by their shares; every second one of a kind is a SIGTERM."""
    total = sum(kind.share for kind in kinds)
    rng = random.Random(seed)
    trials: list[Trial] = []
    for number, kind in enumerate(kinds):
        done = sum(kind.share for kind in kinds[:number])
        # Rounded sums, not rounded shares: they add up to `count`.
        n = round((done + kind.share) * count / total) - round(done * count / total)
        signals = [(signal.SIGKILL, signal.SIGTERM)[(number + i) % 2] for i in range(n)]
        trials += [Trial(kind, one, rng.randrange(1 << 32)) for one in signals]
    rng.shuffle(trials)
    return trials


def _in_parallel(work: Callable[[Item], None], items: Sequence[Item], workers: int) -> None:
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, items))


def _say(begin: float, text: str) -> None:
    print(f"{(time.monotonic() - begin) / 60:5.1f} min  {text}", flush=True)


_COLUMNS = (
    "stage or command", "SIGKILL", "SIGTERM", "of them ended with the result", "killed again", "continued", "identical",
    "orphans", "lost", "damaged", "stop (s)",
)  # fmt: skip


def table(trials: Sequence[Trial], minutes: float, workers: int, seed: int) -> str:
    """Return the table as Markdown, with what went wrong below it."""
    machine = f"{platform.system()}, {describe_machine().cores} cores"
    text = (
        f"Made in {minutes:.0f} minutes ({cpu_seconds() / 60:.0f} of all cores together): {len(trials)} kills, "
        f"{workers} at a time, seed {seed}, {machine}. A stop may take at most {MAX_STOP_SECONDS:.0f} s.\n\n"
        f"| {' | '.join(_COLUMNS)} |\n|{' --- |' * len(_COLUMNS)}\n"
    )
    by_kind: dict[str, list[Trial]] = collections.defaultdict(list)
    for trial in sorted(trials, key=lambda trial: KINDS.index(trial.kind)):
        by_kind[trial.kind.name].append(trial)
    for name, group in by_kind.items():
        text += _row(name, group)
    text += _row("**all**", trials)
    problems = [f"- {trial.kind.name}, {trial.moment}{problem}" for trial in trials for problem in trial.problems]
    return text + ("\nProblems:\n\n" + "\n".join(problems) if problems else "\nNo trial found a problem.")


def _row(name: str, trials: Sequence[Trial]) -> str:
    terms = [trial for trial in trials if trial.number == signal.SIGTERM]
    cells = [
        name,
        len(trials) - len(terms),
        len(terms),
        sum(trial.ended_itself for trial in terms),
        sum(trial.killed_again for trial in trials),
        sum(trial.continued for trial in trials),
        sum(trial.identical for trial in trials),
        sum(len(trial.orphans) for trial in trials),
        sum(len(trial.lost) for trial in trials),
        sum(len(trial.damaged) for trial in trials),
        f"{max((trial.stop_seconds for trial in terms), default=0.0):.1f}",
    ]
    return f"| {' | '.join(map(str, cells))} |\n"


if __name__ == "__main__":
    sys.exit(main())
