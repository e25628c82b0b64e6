"""The house rules that need to see the repository as one package: import contracts and types.

Both tools look through a temporary link ``gaussian_heritage`` to the repository. example: python scripts/check_house.py
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_CODE = ("engine", "gaussian_heritage_addon", "operators", "__init__.py")


def link_repository(folder: Path, repository: Path = ROOT) -> Path:
    """Make ``folder/gaussian_heritage`` hold links to the packages of `repository` and return it."""
    package = folder / "gaussian_heritage"
    package.mkdir()
    for name in _CODE:
        (package / name).symlink_to(repository / name)
    return package


def check_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contracts of .importlinter over the package linked in `folder`."""
    tool = Path(sys.executable).with_name("lint-imports")
    return subprocess.run(
        [tool, "--config", ROOT / ".importlinter", "--no-cache"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def check_types(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run mypy over the engine and the add-on in the package linked in `folder`."""
    packages = ["-p", "gaussian_heritage.engine", "-p", "gaussian_heritage.gaussian_heritage_addon"]
    cache = ROOT / ".mypy_cache"
    return subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml", "--cache-dir", cache, *packages],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def main() -> int:
    """Run both checks and return 1 if one of them found something."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        link_repository(folder)
        failed = False
        for check in (check_imports, check_types):
            done = check(folder)
            print(done.stdout + done.stderr, end="")
            failed = failed or done.returncode != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
