"""Run targets of the Makefile one after the other, all of them even when some fail, and tell the failures at the end.

example: python scripts/run_tests.py --make make lint contracts engine-tests blender-tests
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from places import ROOT


def main() -> int:
    """Run the parts that the command line names; return 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--make", default="make", help="the program make (default: %(default)s)")
    parser.add_argument("parts", nargs="+", metavar="TARGET", help="targets of the Makefile")
    options = parser.parse_args()
    return run_parts(options.parts, options.make)


def run_parts(parts: Sequence[str], make: str, folder: Path = ROOT) -> int:
    """Run each target of the Makefile in `folder`, print what failed, and return 0 if none did, otherwise 1."""
    failed = {}
    for part in parts:
        print(f"== {part}", flush=True)
        if code := subprocess.run([make, "--no-print-directory", part], cwd=folder, check=False).returncode:
            failed[part] = code
    sys.stdout.flush()
    if failed:
        listed = ", ".join(f"{part} (exit code {code})" for part, code in failed.items())
        print(f"{len(failed)} of {len(parts)} parts failed: {listed}. Their output is above.", file=sys.stderr)
        return 1
    print(f"All {len(parts)} parts passed: {', '.join(parts)}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
