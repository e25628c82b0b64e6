"""The engine on Windows' Python, under Wine, as a curator uses it: ``make windows-test``; writes docs/windows.md.

Makes a folder with Wine, Windows' Python and the locked wheels once, runs the tests that make sense there, and goes the
whole way with the installed zip: Set Up Engine from the network and from an offline bundle, photos, a video and given
cameras to exported objects, cancelled and continued. Needs Linux, root, debootstrap, 16 GB of disk, and an hour of two
free cores. It is Windows' Python and Windows' builds of all packages, not Windows: docs/windows.md lists the gaps.

example: python scripts/windows_test.py --doc docs/windows.md
         python scripts/windows_test.py --quick --product ../other-checkout
         python scripts/windows_test.py --only "set up" reconstruct
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from places import ROOT
from windows.launch import ENVIRONMENTS, USER, cache_folder
from windows.packages import install_python, install_wheels
from windows.problem import Problem
from windows.root import alone, make_root, make_template
from windows.steps import Context, Result, Step
from windows.test_steps import test_steps
from windows.way_steps import way_steps

from engine.core.files import write_file

MARK = "## Ran\n"
_TABLE = "| step | result | commit | what was seen |\n| --- | --- | --- | --- |"
_CHANGED = "and changes"


def say(line: str) -> None:
    """Print a line at once."""
    print(line, flush=True)


def make_computer(cache: Path) -> None:
    """Make what is missing or out of date of the folder that all Windows computers come from."""
    with alone(cache):
        make_root(cache, say)
        template = make_template(cache, say)
        install_python(template, say)
        for name in ENVIRONMENTS:
            install_wheels(cache, name, say)


def run_steps(steps: Sequence[Step], context: Context, tell: Callable[[Result], None] = lambda _: None) -> list[Result]:
    """Run the steps in their order; a step of which a needed one failed is not run, and counts as failed.

    `tell` is called with each result at once, so that nothing is lost when a later step is interrupted.
    """
    results: list[Result] = []
    for step in steps:
        say(step.name)
        failed = [one.step.name for one in results if not one.passed and one.step.name in step.needs]
        if failed:
            result = Result(step, False, f"not run, because it needs: {', '.join(failed)}")
        else:
            try:
                result = Result(step, True, step.run(context))
            except Problem as problem:
                result = Result(step, False, str(problem))
            # The other steps tell more than the end of this run would.
            except Exception:
                result = Result(step, False, f"a fault of this script: {traceback.format_exc(limit=-3)}")
        results.append(result)
        tell(result)
        say(f"  {'passed' if result.passed else 'FAILED'}: {result.text}")
    return results


def document(results: Sequence[Result], steps: Sequence[str], commit: str, earlier: str = "") -> str:
    """Return the section of docs/windows.md: a row for each step.

    Parameters
    ----------
    results : sequence of Result
        Of the steps that ran now.
    steps : sequence of str
        Names of all steps, in the order of the rows.
    commit : str
        State of the product that they ran with.
    earlier : str
        The section that is replaced. Its rows of the other steps are kept.
    """
    rows = {}
    if _TABLE in earlier:
        rows = {line.split(" | ")[0].removeprefix("| "): line for line in earlier.partition(_TABLE)[2].splitlines()}
    for result in results:
        seen = " ".join(result.text.split()).replace("|", "\\|")
        passed = "passed" if result.passed else "**failed**"
        rows[result.step.name] = f"| {result.step.name} | {passed} | {commit} | {seen} |"
    lines = [
        f"With Wine 10 (Debian 13) and Windows' Python 3.11.9, as the user `{USER}`. `make windows-test` writes this",
        "section. `--only` and `--quick` replace the rows of the steps that they run, so each row names the commit",
        f"that its step ran with. \"{_CHANGED}\" says that files were changed since that commit.", "", _TABLE,
    ]  # fmt: skip
    lines += [rows.get(name, f"| {name} | **not run** | | |") for name in steps]
    return "\n".join(lines) + "\n"


def commit_of(product: Path) -> str:
    """Return the commit of a checkout, abbreviated, with `_CHANGED` when other files than documents were changed."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=product, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Problem(
                f"{product} must be a checkout of git, so that the results name its commit: {done.stderr.strip()}"
            )
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)docs")
    return git("rev-parse", "--short=8", "HEAD") + (f" {_CHANGED}" if changed else "")


def _writer(file: Path, steps: Sequence[str], product: Path) -> Callable[[Result], None]:
    """Return a function that writes the row of a result into the document."""
    commit = commit_of(product)

    def write(result: Result) -> None:
        head, _, earlier = file.read_text(encoding="utf-8").partition(MARK)
        # Replaced whole: a run beside this one must never read half of it and lose the other rows.
        write_file(file, f"{head}{MARK}\n{document([result], steps, commit, earlier)}")

    return write


def main() -> int:
    """Run the steps and return 0 when all passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--product", type=Path, default=ROOT, help="checkout that is tested (%(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="file for the results")
    parser.add_argument("--quick", action="store_true", help="only tests of processes, files, photos and the installer")
    parser.add_argument(
        "--only", nargs="+", metavar="STEP", help="steps by the beginning of their names, and no others"
    )
    parser.add_argument("--list", action="store_true", help="print the names of the steps")
    parser.add_argument("--keep", action="store_true", help="continue with the computers of the last run")
    options = parser.parse_args()
    every = [*test_steps(quick=False), *way_steps()]
    steps = test_steps(quick=True) if options.quick else every
    if options.only:
        steps = [one for one in steps if any(one.name.startswith(word) for word in options.only)]
    if options.list:
        print("\n".join(one.name for one in steps))
        return 0
    try:
        cache = cache_folder()
        make_computer(cache)
        keep = options.keep or bool(options.only)
        context = Context(options.product.resolve(), cache, keep=keep)
        tell = _writer(options.doc, [one.name for one in every], context.product) if options.doc else lambda _: None
        results = run_steps(steps, context, tell)
    except Problem as problem:
        print(f"Failed: {problem}", file=sys.stderr)
        return 1
    failed = [one for one in results if not one.passed]
    say(f"{len(results) - len(failed)} of {len(results)} steps passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
