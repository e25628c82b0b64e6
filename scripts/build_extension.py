"""Build the extension's zip with Blender's own tool: ``make zip``.

``blender_ext.py`` is part of ``bpy`` and does the same as ``blender --command extension build``: it validates
``blender_manifest.toml`` and writes the zip. The zip is written anew with the version of the engine and without times,
so that the same files give the same bytes. Its contents are checked before it gets its final name.

example: python scripts/build_extension.py --out dist/gaussian_heritage.zip
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import zipfile
from pathlib import Path

from places import PACKAGES, ROOT, python_of

sys.path.insert(0, str(ROOT))
from engine import __version__  # noqa: E402 it imports the standard library alone
from engine.core.system import replace_file  # noqa: E402 as above

MAX_BYTES = 3_000_000
"""Largest size of the zip. The extension is code only, so a larger zip contains a file that does not belong in it."""

MANIFEST = "blender_manifest.toml"
REQUIRED_FILES = (MANIFEST, "__init__.py", "LICENSE")


def main() -> int:
    """Build the zip and return 0, or print its problem and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist" / "gaussian_heritage.zip", help="(default: %(default)s)"
    )
    out = parser.parse_args().out.resolve()
    if problem := build(out):
        print(problem, file=sys.stderr)
        return 1
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")
    return 0


def build(out: Path) -> str:
    """Write the zip `out`, and return a sentence about a failure, empty when there is none."""
    out.parent.mkdir(parents=True, exist_ok=True)
    built, unchecked = out.with_name(out.name + ".built.zip"), out.with_name(out.name + ".tmp.zip")
    # `build` validates the manifest, `validate` the zip that users install.
    problem = run_tool("build", "--source-dir", ROOT, "--output-filepath", built)
    if not problem:
        write_anew(built, unchecked, __version__)
        built.unlink()
        problem = run_tool("validate", unchecked) or "\n".join(find_problems(unchecked))
        if problem:
            unchecked.unlink()
        else:
            replace_file(unchecked, out)
    return problem


def run_tool(*arguments: object) -> str:
    """Run Blender's tool for extensions, and return a sentence about a failure, empty when there is none."""
    tool = find_tool()
    if tool is None:
        return f"Blender's tool for extensions is missing in {python_of('blender-4.5')}; run `make setup`."
    command = [python_of("blender-4.5"), tool, *arguments]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    return f"Blender's tool failed in {arguments[0]}:\n{done.stdout}{done.stderr}" if done.returncode else ""


def write_anew(source: Path, target: Path, version: str) -> None:
    """Write the files of a zip in the order of their names, with one time and mode, and a version in the manifest."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in sorted(name for name in old.namelist() if not name.endswith("/")):
            content = old.read(name)
            if name == MANIFEST:
                content = re.sub(rb'^version = ".*"$', f'version = "{version}"'.encode(), content, flags=re.MULTILINE)
            entry = zipfile.ZipInfo(name)  # the time is that of the beginning of zip files, 1980
            entry.external_attr = 0o644 << 16
            entry.create_system = 3  # as on Linux, also where the zip is made on Windows
            new.writestr(entry, content, zipfile.ZIP_DEFLATED, compresslevel=9)


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
