"""Build the extension zip with Blender's own tool: ``make zip``.

Runs in a Blender environment (bpy from PyPI). The zip holds the manifest, ``__init__.py``, LICENSE and the three packages.
example: .venv/blender-4.5/bin/python scripts/build_extension.py --out dist/gaussian_heritage.zip
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_FILES = ("blender_manifest.toml", "__init__.py", "LICENSE")
_PACKAGES = ("gaussian_heritage_addon", "engine", "operators")


def blender_tool() -> Path:
    """Return the path of Blender's extension command line inside the installed bpy."""
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        raise SystemExit("This Python has no bpy. Run `make setup` and use .venv/blender-4.5.")
    (tool,) = Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    return tool


def build(out: Path) -> None:
    """Validate and build the zip at `out`; a failing build leaves an earlier zip as it was."""
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "gaussian_heritage"
        source.mkdir()
        for file in _FILES:
            shutil.copy2(ROOT / file, source / file)
        for package in _PACKAGES:
            shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
        tool = [sys.executable, str(blender_tool())]
        zip_file = Path(name) / "gaussian_heritage.zip"
        subprocess.run([*tool, "validate", str(source)], check=True)
        subprocess.run([*tool, "build", "--source-dir", str(source), "--output-filepath", str(zip_file)], check=True)
        out.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(zip_file, out)


def main() -> int:
    """Build and say where the zip lies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "gaussian_heritage.zip")
    out: Path = parser.parse_args().out
    build(out)
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
