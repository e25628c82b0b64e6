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
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from places import ROOT
from windows.launch import ENVIRONMENTS, USER, cache_folder
from windows.packages import install_python, install_wheels
from windows.problem import Problem
from windows.root import alone, make_root, make_template
from windows.steps import Context, Result, Step
from windows.test_steps import test_steps
from windows.way_steps import way_steps

MARK = "## Ran\n"


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


def run_steps(steps: Sequence[Step], context: Context) -> list[Result]:
    """Run the steps in their order; a step of which a needed one failed is not run, and counts as failed."""
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
        say(f"  {'passed' if result.passed else 'FAILED'}: {result.text}")
    return results


def document(results: Sequence[Result]) -> str:
    """Return the results as a section of docs/windows.md."""
    lines = [
        f"With Wine 10 (Debian 13) and Windows' Python 3.11.9, as the user `{USER}`.", "",
        "| step | result | what was seen |", "| --- | --- | --- |",
    ]  # fmt: skip
    for result in results:
        seen = " ".join(result.text.split()).replace("|", "\\|")
        lines.append(f"| {result.step.name} | {'passed' if result.passed else '**failed**'} | {seen} |")
    return "\n".join(lines) + "\n"


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
    parser.add_argument("--engine-folder", help="of Windows, for the engine (default: the product's own choice)")
    options = parser.parse_args()
    tests = test_steps(quick=options.quick)
    steps = tests if options.quick else [*tests, *way_steps()]
    if options.only:
        steps = [one for one in steps if any(one.name.startswith(word) for word in options.only)]
    if options.list:
        print("\n".join(one.name for one in steps))
        return 0
    try:
        cache = cache_folder()
        make_computer(cache)
        variables = {"GAUSSIAN_HERITAGE_ENGINE": options.engine_folder} if options.engine_folder else {}
        keep = options.keep or bool(options.only)
        context = Context(options.product.resolve(), cache, keep=keep, variables=variables)
        results = run_steps(steps, context)
    except Problem as problem:
        print(f"Failed: {problem}", file=sys.stderr)
        return 1
    if options.doc:
        head = options.doc.read_text(encoding="utf-8").partition(MARK)[0]
        options.doc.write_text(f"{head}{MARK}\n{document(results)}", encoding="utf-8")
    failed = [one for one in results if not one.passed]
    say(f"{len(results) - len(failed)} of {len(results)} steps passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
