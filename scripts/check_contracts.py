"""Check the import contracts and the types of the repository: ``make contracts`` and ``make types``.

import-linter and mypy see the repository as one package through a temporary link ``gaussian_heritage``. With three
separate root packages they would miss relative imports between them, and contracts would pass by mistake.

example: python scripts/check_contracts.py imports types scripts
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from places import PACKAGES, ROOT, program_of, python_of

_CODE = (*PACKAGES, "__init__.py")


def link_repository(folder: Path) -> None:
    """Create ``folder/gaussian_heritage`` with the packages of the repository.

    The packages are linked, or copied where links are not permitted (Windows without developer mode).
    """
    package = folder / "gaussian_heritage"
    package.mkdir()
    for name in _CODE:
        try:
            (package / name).symlink_to(ROOT / name, target_is_directory=(ROOT / name).is_dir())
        except OSError:
            copy_code(ROOT / name, package / name)


def copy_code(source: Path, target: Path) -> None:
    """Copy a package or a module without compiled files."""
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    else:
        shutil.copy(source, target)


def check_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contracts of .importlinter over the package in `folder`."""
    tool = program_of("engine", "lint-imports")
    return _run([tool, "--config", ROOT / ".importlinter", "--no-cache"], folder)


def check_types(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run mypy over the three packages in `folder`."""
    packages = [word for name in PACKAGES for word in ("-p", f"gaussian_heritage.{name}")]
    options = ["--config-file", ROOT / "pyproject.toml", "--cache-dir", ROOT / ".mypy_cache"]
    return _run([python_of("engine"), "-m", "mypy", *options, *packages, "-m", "gaussian_heritage"], folder)


def check_script_types(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run mypy over the modules in scripts/, which is not a package."""
    modules = [word for path in sorted((ROOT / "scripts").glob("*.py")) for word in ("-m", path.stem)]
    options = ["--config-file", ROOT / "pyproject.toml", "--cache-dir", ROOT / ".mypy_cache"]
    return _run([python_of("engine"), "-m", "mypy", *options, *modules], folder)


def _run(command: list[object], folder: Path) -> subprocess.CompletedProcess[str]:
    # tests/contracts contains the custom contract type.
    path = os.pathsep.join([str(folder), str(ROOT / "tests" / "contracts")])
    return subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        # lint-imports prints box characters, which Windows code pages do not have.
        env={**os.environ, "PYTHONPATH": path, "PYTHONUTF8": "1", "COLUMNS": "160"},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def main() -> int:
    """Run the named checks (all by default) and return 1 if one of them failed."""
    checks = {"imports": check_imports, "types": check_types, "scripts": check_script_types}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        link_repository(folder)
        failed = False
        for check in sys.argv[1:] or list(checks):
            result = checks[check](folder)
            # Print paths in the repository, not below the link.
            print((result.stdout + result.stderr).replace(f"gaussian_heritage{os.sep}", ""), end="", flush=True)
            failed = failed or result.returncode != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
