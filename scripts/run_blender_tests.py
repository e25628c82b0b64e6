"""Run tests/blender in each available Blender with the installed zip, without the repository in ``sys.path``.

The Blenders run side by side; the output of each is shown when it has ended. Other arguments are those of pytest.

example: python scripts/run_blender_tests.py --blender 5.3 -k zip
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from places import BLENDERS, ROOT, blender_environments, python_of


def main() -> int:
    """Run the tests; return 1 if some failed or the Blender that builds the extension is missing."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--blender", choices=BLENDERS, help="version to test in (default: each one that is there)")
    options, for_pytest = parser.parse_known_args()
    blenders = [(name, python_of(name)) for name in blender_environments()]
    if not blenders[0][1].exists():
        print(f"{blenders[0][0]} is missing. Run `make setup`.", file=sys.stderr)
        return 1
    failed = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # The tests are copied, so that they cannot import from the repository by mistake.
        shutil.copytree(ROOT / "tests" / "blender", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
        zip_file = folder / "gaussian_heritage.zip"
        subprocess.run([blenders[0][1], ROOT / "scripts" / "build_extension.py", "--out", zip_file], check=True)
        chosen = [one for one in blenders if options.blender in (None, one[0].removeprefix("blender-"))]
        # Each suite keeps about one core busy.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            runs = {}
            for label, python in chosen:
                left_out = [] if options.blender else left_out_in(label, [name for name, _ in blenders])
                marked = ["-m", " and ".join(f"not {mark}" for mark in left_out)] if left_out else []
                runs[label] = pool.submit(run_tests, python, folder, zip_file, [*marked, *for_pytest])
            for label, run in runs.items():
                done = run.result()
                print(f"{label}:\n{done.stdout}", flush=True)
                failed = failed or done.returncode != 0
    return int(failed)


def left_out_in(label: str, labels: Sequence[str]) -> list[str]:
    """Return the marks of tests that are left out in one of several Blenders, which are given from old to new."""
    # What takes long is checked in the oldest and the newest Blender, what depends on none of them in the newest.
    slow = ["slow"] if label not in (labels[0], labels[-1]) else []
    return [*slow, *(["once"] if label != labels[-1] else [])]


def run_tests(python: Path, folder: Path, zip_file: Path, arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run the tests of `folder` in the Blender of `python`, which gets the zip; return its output and exit code."""
    environment = {
        **os.environ,
        "GAUSSIAN_HERITAGE_ZIP": str(zip_file),
        "GAUSSIAN_HERITAGE_SHARED": str(folder / "shared"),
        "GAUSSIAN_HERITAGE_PYTHON": str(python_of("engine")),
        "GAUSSIAN_HERITAGE_DEMO": str(ROOT / "demo"),
        "GAUSSIAN_HERITAGE_FIXTURES": str(ROOT / "tests" / "fixtures"),
    }
    environment.pop("PYTHONPATH", None)
    tests = folder / "tests"
    options = ["-P", "-m", "pytest", "-p", "no:cacheprovider", "-q", "-c", tests / "pytest.ini"]
    words = [str(part) for part in [python, *options, *arguments, tests]]
    return subprocess.run(
        words, cwd=folder, env=environment, check=False, text=True, errors="replace",
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
