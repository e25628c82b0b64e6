"""Run tests/blender in each available Blender with the installed zip, without the repository in ``sys.path``.

example: python scripts/run_blender_tests.py
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from places import ROOT, blender_environments, python_of


def main() -> int:
    """Run the tests; return 1 if some failed or Blender 4.5 is missing."""
    blenders = [(name, python_of(name)) for name in blender_environments()]
    if not blenders[0][1].exists():
        print("Blender 4.5 is missing. Run `make setup`.", file=sys.stderr)
        return 1
    failed = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # The tests are copied, so that they cannot import from the repository by mistake.
        shutil.copytree(ROOT / "tests" / "blender", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
        zip_file = folder / "gaussian_heritage.zip"
        subprocess.run([blenders[0][1], ROOT / "scripts" / "build_extension.py", "--out", zip_file], check=True)
        for label, python in blenders:
            print(f"{label}:", flush=True)
            environment = {
                **os.environ,
                "GAUSSIAN_HERITAGE_ZIP": str(zip_file),
                "GAUSSIAN_HERITAGE_PYTHON": str(python_of("engine")),
                "GAUSSIAN_HERITAGE_DEMO": str(ROOT / "demo"),
                "GAUSSIAN_HERITAGE_FIXTURES": str(ROOT / "tests" / "fixtures"),
            }
            environment.pop("PYTHONPATH", None)
            command = [
                python,
                "-P",
                "-m",
                "pytest",
                "-p",
                "no:cacheprovider",
                "-q",
                "-c",
                folder / "tests" / "pytest.ini",
                *sys.argv[1:],
            ]
            result = subprocess.run(
                [str(part) for part in [*command, folder / "tests"]], cwd=folder, env=environment, check=False
            )
            failed = failed or result.returncode != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
