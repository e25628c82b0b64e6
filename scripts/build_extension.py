"""Build the extension's zip with Blender's own tool: ``make zip``.

``blender_ext.py`` travels inside ``bpy`` and does what ``blender --command extension build`` does: it checks
``blender_manifest.toml``, then packs. Its result is looked through before it gets its name.

example: python scripts/build_extension.py --out dist/gaussian_heritage.zip
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import zipfile
from pathlib import Path

from places import PACKAGES, ROOT, python_of

MAX_BYTES = 3_000_000
"""The extension is code; whatever makes it larger than this does not belong in it."""

FILES = ("blender_manifest.toml", "__init__.py", "LICENSE")


def main() -> int:
    """Build the zip and return 0, or say what is wrong with it and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist" / "gaussian_heritage.zip", help="(default: %(default)s)"
    )
    out = parser.parse_args().out.resolve()
    tool = find_tool()
    if tool is None:
        print(f"Blender's build tool is missing in {python_of('blender-4.5')}; run `make setup`.", file=sys.stderr)
        return 1
    out.parent.mkdir(parents=True, exist_ok=True)
    unchecked = out.with_name(out.name + ".tmp.zip")
    # `build` validates the manifest; `validate` on the zip then checks what a person would install.
    build = ["build", "--source-dir", ROOT, "--output-filepath", unchecked]
    for step in (build, ["validate", unchecked]):
        command = [python_of("blender-4.5"), tool, *step]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"Blender's tool refused to {step[0]} the extension:\n{done.stdout}{done.stderr}", file=sys.stderr)
            return 1
    problems = look_through(unchecked)
    if problems:
        print("\n".join(problems), file=sys.stderr)
        unchecked.unlink()
        return 1
    os.replace(unchecked, out)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")
    return 0


def find_tool() -> Path | None:
    """Return ``blender_ext.py`` of the 4.5 environment, found without importing ``bpy``."""
    library = python_of("blender-4.5").parent.parent
    return next(library.glob("**/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"), None)


def look_through(zip_file: Path) -> list[str]:
    """Return what is in the zip and should not be, or should be and is not, as sentences."""
    with zipfile.ZipFile(zip_file) as archive:
        names = archive.namelist()
    problems = [f"{zip_file.name} lacks {name}." for name in FILES if name not in names]
    problems += [
        f"{zip_file.name} lacks the package {name}." for name in PACKAGES if f"{name}/__init__.py" not in names
    ]
    problems += [
        f"{name} is in the extension and should not be; exclude it in blender_manifest.toml."
        for name in names
        if not belongs(name)
    ]
    size = zip_file.stat().st_size
    if size > MAX_BYTES:
        problems.append(f"{zip_file.name} has {size} bytes, more than {MAX_BYTES}.")
    return problems


def belongs(name: str) -> bool:
    """Return whether a path may be in the extension."""
    parts = name.split("/")
    if any(part.startswith(".") or part == "__pycache__" for part in parts):
        return False
    return name in FILES or (parts[0] in PACKAGES and not name.endswith((".pyc", ".pyo", ".so", ".pyd", ".zip")))


if __name__ == "__main__":
    sys.exit(main())
