"""Open hostile projects and .blend files with every command and button, and look for changes outside: ``make hostile``.

example: python -m benchmarks.security.hostile --doc docs/security_hostile.md
"""

from __future__ import annotations

import argparse
import collections
import functools
import json
import os
import shlex
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from engine.core.system import describe_machine
from engine.install.models import models_folder
from engine.pipeline.planning.benchmark import calibrate

from ..documents import print_table
from ..places import ROOT, python_of
from .hostile_blends import BLENDS
from .hostile_cases import HONEST, Case, Sandbox
from .hostile_engine import ALL_CASES, ALLOWED, COMMANDS, Outcome

_SECONDS = 3600
_MARK = "OUTCOME "
"""Begins the lines of Blender's output that are ours."""
_SITECUSTOMIZE = """
import os, sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from hostile_audit import watch

def found(text):
    with open({found!r}, "a", encoding="utf-8") as stream:
        stream.write(text.replace("\\n", " ") + "\\n")

watch(lambda: [*map(Path, os.environ["HERITAGE_HOSTILE_ALLOWED"].split(os.pathsep)), *map(Path, {allowed!r})], found)
"""
"""Startup code of the engine's Python that Blender starts."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all cases and write the table; return 1 when something outside of a project was changed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.security.hostile", description=__doc__)
    parser.add_argument("--only", default="", help="cases with this text in their names")
    parser.add_argument("--workers", type=int, default=2, help="processes at the same time (default: %(default)s)")
    parser.add_argument("--doc", type=Path, help="put the table between the marks of this document")
    options = parser.parse_args(arguments)
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="heritage-hostile-") as name:
        folder = Path(name).resolve()
        numbers = [number for number, case in enumerate(ALL_CASES) if options.only in case.name]
        environment = _environment(folder)
        embeddings = folder / "embeddings"
        embeddings.mkdir()
        _engine(folder / "honest", embeddings, [], environment)
        tasks: list[Callable[[], list[Outcome]]] = [lambda: run_blender(folder, embeddings, numbers, environment)]
        # Dealt out, so that each worker gets short and long cases.
        shares = [numbers[start :: 4 * options.workers] for start in range(4 * options.workers)]
        tasks += [
            functools.partial(_engine, folder / f"engine-{n}", embeddings, share, environment)
            for n, share in enumerate(shares)
            if share
        ]

        def run(task: Callable[[], list[Outcome]]) -> list[Outcome]:
            found = task()
            # An hour on a busy machine: what is found is said before the end.
            minutes = (time.monotonic() - begin) / 60
            print(f"{minutes:5.1f} min  {len(found)} steps", *problems_of(found), sep="\n", flush=True)
            return found

        with ThreadPoolExecutor(options.workers) as pool:
            outcomes = [outcome for found in pool.map(run, tasks) for outcome in found]
    print_table(table(outcomes, (time.monotonic() - begin) / 60), options.doc, "hostile")
    return int(any(outcome.changed or outcome.audited or outcome.is_traceback for outcome in outcomes))


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of all processes: what a user's programs write goes to folders in `folder`."""
    user = folder / "user"
    (user / "tmp").mkdir(parents=True)
    os.environ["GAUSSIAN_HERITAGE_CALIBRATION"] = str(user / "calibration.json")
    calibrate(describe_machine(), emit=lambda event: None)
    return {
        **os.environ,
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(user / "tmp"),
        "MPLCONFIGDIR": str(user / "matplotlib"),
        ALLOWED: os.pathsep.join([str(user), str(models_folder().parent.resolve())]),
    }


def _engine(root: Path, embeddings: Path, numbers: Sequence[int], environment: dict[str, str]) -> list[Outcome]:
    """Put the hostile projects `numbers` through the engine's commands; without any, make the embeddings."""
    module = "benchmarks.security.hostile_engine"
    command = [sys.executable, "-m", module, str(root), str(embeddings), *map(str, numbers)]
    answer = _run(command, {**environment, "PYTHONPATH": str(ROOT)})
    outcomes = [Outcome(**json.loads(line)) for line in answer.stdout.splitlines()]
    return outcomes + _failure("the engine", answer, [ALL_CASES[n].name for n in numbers] or [HONEST.name], outcomes)


def run_blender(folder: Path, embeddings: Path, numbers: Sequence[int], environment: dict[str, str]) -> list[Outcome]:
    """Open the hostile projects `numbers` and all hostile .blend files in Blender."""
    zip_file, found, resources = folder / "extension.zip", folder / "engine-found.txt", folder / "resources"
    subprocess.run([sys.executable, ROOT / "scripts" / "build_extension.py", "--out", zip_file], check=True)
    resources.mkdir()

    def made(name: str, case: Case) -> str:
        sandbox = Sandbox(folder / name, embeddings)
        sandbox.make(case)
        return str(sandbox.root)

    cases = {n: ALL_CASES[n] for n in numbers if not ALL_CASES[n].is_package}
    projects = [(case.name, made(f"project-{n}", case), case.photo) for n, case in cases.items()]
    work = {
        "resources": str(resources),
        "zip": str(zip_file),
        "python": str(_audited_python(folder, found, [*environment[ALLOWED].split(os.pathsep), str(resources)])),
        "engine_found": str(found),
        "projects": projects,
        "blends": [made(f"blend-{n}", HONEST) for n, _ in enumerate(BLENDS)],
    }
    answer = _run(
        [str(python_of("blender-4.5")), str(Path(__file__).parent / "hostile_blender.py"), json.dumps(work)],
        environment,
    )
    lines = [line.removeprefix(_MARK) for line in answer.stdout.splitlines() if line.startswith(_MARK)]
    outcomes = [Outcome(**json.loads(line)) for line in lines]
    names = [name for name, _, _ in projects] + [name for name, _ in BLENDS]
    return outcomes + _failure("Blender", answer, names, outcomes)


def _audited_python(folder: Path, found: Path, allowed: Sequence[str]) -> Path:
    """Write a program that starts the engine's Python with the audit hook, and return it."""
    startup = folder / "startup"
    startup.mkdir()
    code = _SITECUSTOMIZE.format(folder=str(Path(__file__).parent), found=str(found), allowed=allowed)
    (startup / "sitecustomize.py").write_text(code, encoding="utf-8")
    program = folder / "engine-python"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(startup))}:"$PYTHONPATH" exec {shlex.quote(sys.executable)} "$@"\n',
        encoding="utf-8",
    )
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


def _run(command: Sequence[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, errors="replace", check=False,
        timeout=_SECONDS,
    )  # fmt: skip


def _failure(
    what: str, answer: subprocess.CompletedProcess[str], names: Sequence[str], outcomes: Sequence[Outcome]
) -> list[Outcome]:
    """Return an outcome for a process that died: the case that it was working on counts as failed."""
    if answer.returncode == 0:
        return []
    last = outcomes[-1].case if outcomes else names[0]
    lines = [line for line in answer.stderr.strip().splitlines() if "leak detector" not in line][-3:]
    return [Outcome(last, what, answer.returncode, f"Traceback: the process ended: {' '.join(lines)}")]


_COLUMNS = ("case", "steps", "refused", "outside", "bytes", "audited", "tracebacks")


def table(outcomes: Sequence[Outcome], minutes: float) -> str:
    """Return the table as Markdown, with what was found below it."""
    by_case: dict[str, list[Outcome]] = collections.defaultdict(list)
    for outcome in outcomes:
        by_case[outcome.case].append(outcome)
    order = [name for name in (*(case.name for case in ALL_CASES), *(name for name, _ in BLENDS)) if name in by_case]
    text = (
        f"Made in {minutes:.0f} minutes: {len(by_case)} cases, {len(outcomes)} commands and buttons. The commands of "
        f"the engine: {', '.join(f'`{one}`' for one in COMMANDS)}.\n\n"
        f"| {' | '.join(_COLUMNS)} |\n|{' --- |' * len(_COLUMNS)}\n"
    )
    for name in order:
        text += _row(name, by_case[name])
    text += _row("**all**", outcomes)
    problems = problems_of(outcomes)
    return text + ("\nProblems:\n\n" + "\n".join(problems) if problems else "\nNothing was changed outside.")


def problems_of(outcomes: Sequence[Outcome]) -> list[str]:
    """Return what was changed outside, tried there, or no sentence of ours: an item of a list for each."""
    return [
        f"- {outcome.case}; {outcome.command}: {finding}"
        for outcome in outcomes
        for finding in (*outcome.changed, *outcome.audited, *([outcome.sentence] if outcome.is_traceback else []))
    ]


def _row(name: str, outcomes: Sequence[Outcome]) -> str:
    cells = [
        name.replace("|", "\\|"),
        len(outcomes),
        sum(bool(outcome.sentence) for outcome in outcomes),
        sum(len(outcome.changed) for outcome in outcomes),
        sum(outcome.n_bytes for outcome in outcomes),
        sum(len(outcome.audited) for outcome in outcomes),
        sum(outcome.is_traceback for outcome in outcomes),
    ]
    return f"| {' | '.join(map(str, cells))} |\n"


if __name__ == "__main__":
    sys.exit(main())
