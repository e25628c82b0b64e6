"""Build the extension's zip with Blender's own tool: ``make zip``.

``blender_ext.py`` is part of ``bpy`` and does the same as ``blender --command extension build``: it validates
``blender_manifest.toml`` and writes the zip. The contents of the zip are checked before it gets its final name.

example: python scripts/build_extension.py --out dist/gaussian_heritage.zip
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import zipfile
from pathlib import Path

from places import PACKAGES, ROOT, python_of

sys.path.insert(0, str(ROOT))
from engine.core.system import replace_file  # noqa: E402 it imports the standard library alone

MAX_BYTES = 3_000_000
"""Largest size of the zip. The extension is code only, so a larger zip contains a file that does not belong in it."""

REQUIRED_FILES = ("blender_manifest.toml", "__init__.py", "LICENSE")


def main() -> int:
    """Build the zip and return 0, or print its problems and return 1."""
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
    # `build` validates the manifest, `validate` the zip that users install.
    build = ["build", "--source-dir", ROOT, "--output-filepath", unchecked]
    for step in (build, ["validate", unchecked]):
        command = [python_of("blender-4.5"), tool, *step]
        result = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if result.returncode:
            print(f"Blender's tool could not {step[0]} the extension:\n{result.stdout}{result.stderr}", file=sys.stderr)
            return 1
    problems = find_problems(unchecked)
    if problems:
        print("\n".join(problems), file=sys.stderr)
        unchecked.unlink()
        return 1
    replace_file(unchecked, out)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")
    return 0


def find_tool() -> Path | None:
    """Return ``blender_ext.py`` of the 4.5 environment, found without importing ``bpy``."""
    library = python_of("blender-4.5").parent.parent
    return next(library.glob("**/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"), None)


def find_problems(zip_file: Path) -> list[str]:
    """Return a sentence for each missing or unwanted file in the zip, and for its size when it is too large."""
    with zipfile.ZipFile(zip_file) as archive:
        names = archive.namelist()
    problems = [f"{zip_file.name} lacks {name}." for name in REQUIRED_FILES if name not in names]
    problems += [
        f"{zip_file.name} lacks the package {name}." for name in PACKAGES if f"{name}/__init__.py" not in names
    ]
    problems += [
        f"{name} is in the extension and should not be; exclude it in blender_manifest.toml."
        for name in names
        if not is_allowed(name)
    ]
    size = zip_file.stat().st_size
    if size > MAX_BYTES:
        problems.append(f"{zip_file.name} has {size} bytes, more than {MAX_BYTES}.")
    return problems


def is_allowed(name: str) -> bool:
    """Return whether a file may be in the extension."""
    parts = name.split("/")
    if any(part.startswith(".") or part == "__pycache__" for part in parts):
        return False
    return name in REQUIRED_FILES or (
        parts[0] in PACKAGES and not name.endswith((".pyc", ".pyo", ".so", ".pyd", ".zip"))
    )


if __name__ == "__main__":
    sys.exit(main())
