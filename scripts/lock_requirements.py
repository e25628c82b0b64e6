"""Write ``requirements/locked-*.txt``: all packages of each environment with the SHA-256 of all their files on PyPI.

Needs uv 0.5 or newer in PATH and the network. Standard library only. Versions that are locked already stay, unless the
requirements ask for others or ``--upgrade`` is given. PyPI is asked whatever index is configured on this computer,
because a mirror may list only some of the files.

example: python scripts/lock_requirements.py
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from places import ROOT

__all__ = ["main"]

REQUIREMENTS = ROOT / "requirements"
INDEX_VARIABLES = ("UV_DEFAULT_INDEX", "UV_INDEX", "UV_INDEX_URL", "UV_EXTRA_INDEX_URL", "UV_FIND_LINKS")
ONLY_FOR_CUDA = ("nvidia-", "cuda-", "triton")

LOCKS = {
    "engine-dev.txt": (
        "3.11",
        {"engine": "All but torch", "torch": "torch alone", "cuda": "What only CUDA builds of torch need"},
    ),
    "blender-4.5.txt": ("3.11", {"blender-4.5": "All but bpy", "bpy-4.5": "bpy alone"}),
    "blender-5.2.txt": ("3.13", {"blender-5.2": "All but bpy", "bpy-5.2": "bpy alone"}),
}
"""Requirements: the version of Python, and the locked files with what is in each of them."""


def main() -> int:
    """Write the files and return 0, or print the problem and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upgrade", action="store_true", help="take the newest versions that the requirements allow")
    options = parser.parse_args()
    uv = shutil.which("uv")
    if uv is None:
        print("uv was not found; install it with `pip install uv`, then run this again.", file=sys.stderr)
        return 1
    for requirements, (python, parts) in LOCKS.items():
        texts = {name: "" for name in parts}
        for package, text in resolve(uv, requirements, python, list(parts), upgrade=options.upgrade):
            texts[part_of(package, list(parts))] += text
        for name, text in texts.items():
            file = REQUIREMENTS / f"locked-{name}.txt"
            file.write_text(f"# {parts[name]}, for {requirements}. Written by scripts/lock_requirements.py.\n{text}")
            print(f"{file.name}: {len(re.findall('^[^ ]+==', text, flags=re.MULTILINE))} packages")
    return 0


def resolve(uv: str, requirements: str, python: str, parts: list[str], *, upgrade: bool) -> Iterator[tuple[str, str]]:
    """Yield the name of each package that the requirements need on any platform, and its lines with the hashes."""
    environment = {name: value for name, value in os.environ.items() if name not in INDEX_VARIABLES}
    with tempfile.TemporaryDirectory() as folder:
        locked = Path(folder) / "locked.txt"
        old = [REQUIREMENTS / f"locked-{part}.txt" for part in parts]
        locked.write_text("".join(file.read_text() for file in old if file.exists()))
        command = [uv, "pip", "compile", "--no-config", "--quiet", "--universal", "--python-version", python]
        command += ["--generate-hashes", "--only-binary", ":all:", "--no-header", "--no-annotate", "--no-strip-extras"]
        command += ["--upgrade"] if upgrade else []
        subprocess.run(
            [*command, str(REQUIREMENTS / requirements), "--output-file", str(locked)], check=True, env=environment
        )
        for text in re.split(r"^(?=\S)", locked.read_text(), flags=re.MULTILINE):
            name = re.match(r"[\w.-]+", text)
            if name and "sys_platform == 'emscripten'" not in text:  # Python in a web browser
                yield name[0], text


def part_of(package: str, parts: list[str]) -> str:
    """Return the locked file that a package belongs to."""
    if package in ("torch", "bpy"):
        return parts[1]
    return "cuda" if package.startswith(ONLY_FOR_CUDA) else parts[0]


if __name__ == "__main__":
    sys.exit(main())
