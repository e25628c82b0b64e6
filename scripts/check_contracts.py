"""The house rules that need to see the repository as one package: import contracts and types.

Both tools look through a temporary link ``gaussian_heritage`` to the repository: with three separate roots, a
relative import across them is invisible and a contract passes falsely.

example: python scripts/check_contracts.py imports types scripts
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from places import PACKAGES, ROOT, python_of

__all__ = ["check_imports", "check_script_types", "check_types", "copy_code", "link_repository"]

_CODE = (*PACKAGES, "__init__.py")


def link_repository(folder: Path, repository: Path = ROOT) -> Path:
    """Make ``folder/gaussian_heritage`` hold the packages of `repository` and return it.

    Links where the system lets us make them, copies elsewhere (Windows without developer mode).
    """
    package = folder / "gaussian_heritage"
    package.mkdir()
    for name in _CODE:
        try:
            (package / name).symlink_to(repository / name, target_is_directory=(repository / name).is_dir())
        except OSError:
            copy_code(repository / name, package / name)
    return package


def copy_code(source: Path, target: Path) -> None:
    """Copy a package or a module, without what Python compiled from it."""
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    else:
        shutil.copy(source, target)


def check_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contracts of .importlinter over the package in `folder`."""
    tool = python_of("engine").with_name("lint-imports.exe" if os.name == "nt" else "lint-imports")
    return _run([tool, "--config", ROOT / ".importlinter", "--no-cache"], folder)


def check_types(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run mypy over the three packages in `folder`."""
    packages = [word for name in PACKAGES for word in ("-p", f"gaussian_heritage.{name}")]
    options = ["--config-file", ROOT / "pyproject.toml", "--cache-dir", ROOT / ".mypy_cache"]
    return _run([python_of("engine"), "-m", "mypy", *options, *packages, "-m", "gaussian_heritage"], folder)


def check_script_types(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run mypy over scripts/, which are no package: each finds the others beside itself."""
    modules = [word for path in sorted((ROOT / "scripts").glob("*.py")) for word in ("-m", path.stem)]
    options = ["--config-file", ROOT / "pyproject.toml", "--cache-dir", ROOT / ".mypy_cache"]
    return _run([python_of("engine"), "-m", "mypy", *options, *modules], folder)


def _run(command: list[object], folder: Path) -> subprocess.CompletedProcess[str]:
    # The contract type of our own lies with the tests.
    path = os.pathsep.join([str(folder), str(ROOT / "tests" / "contracts")])
    return subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        # UTF-8: lint-imports draws its name with box characters, which a Windows code page cannot hold.
        env={**os.environ, "PYTHONPATH": path, "PYTHONUTF8": "1", "COLUMNS": "160"},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def main() -> int:
    """Run the checks that are named (all by default) and return 1 if one of them found something."""
    checks = {"imports": check_imports, "types": check_types, "scripts": check_script_types}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        link_repository(folder)
        failed = False
        for wanted in sys.argv[1:] or list(checks):
            done = checks[wanted](folder)
            # Paths as a person can open them, not those below the link.
            print((done.stdout + done.stderr).replace(f"gaussian_heritage{os.sep}", ""), end="", flush=True)
            failed = failed or done.returncode != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
