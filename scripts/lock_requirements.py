"""Write ``locked-*.txt``: all packages of each environment with the SHA-256 of all their files on PyPI.

Those that the engine needs are in ``engine/install/environment``, since Blender installs them; the others in
``requirements``.

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

from places import BLENDERS, ROOT

REQUIREMENTS = ROOT / "requirements"
ENGINE = ROOT / "engine" / "install" / "environment"
INDEX_VARIABLES = ("UV_DEFAULT_INDEX", "UV_INDEX", "UV_INDEX_URL", "UV_EXTRA_INDEX_URL", "UV_FIND_LINKS")
ONLY_FOR_CUDA = ("nvidia-", "cuda-", "triton")

LOCKS = {
    "engine-dev.txt": (
        "3.11",
        {
            ENGINE / "locked-engine.txt": "What the engine needs, without torch",
            REQUIREMENTS / "locked-serve.txt": "What the web server needs besides, for serve.txt",
            REQUIREMENTS / "locked-batch.txt": "What batch needs besides, for batch.txt",
            REQUIREMENTS / "locked-formats.txt": "What exports as USD and SPZ 4 need besides, for formats.txt",
            REQUIREMENTS / "locked-dev.txt": "What developers need besides, for engine-dev.txt",
            ENGINE / "locked-torch.txt": "torch alone",
            ENGINE / "locked-cuda.txt": "What only CUDA builds of torch need",
        },
    ),
    **{
        f"blender-{version}.txt": (
            ".".join(str(part) for part in python),
            {
                REQUIREMENTS / f"locked-blender-{version}.txt": "All but bpy",
                REQUIREMENTS / f"locked-bpy-{version}.txt": "bpy alone",
            },
        )
        for version, python in BLENDERS.items()
    },
    "installation.txt": (
        "3.11",
        {
            REQUIREMENTS / "locked-node.txt": "npm, where Node.js is not installed, to build the page of the server",
            ENGINE / "locked-pip.txt": "pip, for a Python that brings none",
        },
    ),
    "sbom.txt": ("3.11", {REQUIREMENTS / "locked-sbom.txt": "What writes the SBOM of the container image"}),
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
        files = list(parts)
        needed = {"engine": set[str](), "serve": set[str](), "batch": set[str](), "formats": set[str]()}
        if requirements == "engine-dev.txt":
            for part in needed:
                needed[part] = {name for name, _ in resolve(uv, f"{part}.txt", python, files, upgrade=options.upgrade)}
        texts = dict.fromkeys(files, "")
        for package, text in resolve(uv, requirements, python, files, upgrade=options.upgrade):
            texts[file_of(package, files, needed)] += text
        for file, text in texts.items():
            file.write_text(f"# {parts[file]}. Written by scripts/lock_requirements.py.\n{text}")
            print(f"{file.name}: {len(re.findall('^[^ ]+==', text, flags=re.MULTILINE))} packages")
    return 0


def resolve(uv: str, requirements: str, python: str, files: list[Path], *, upgrade: bool) -> Iterator[tuple[str, str]]:
    """Yield the name of each package that the requirements need on any platform, and its lines with the hashes."""
    environment = {name: value for name, value in os.environ.items() if name not in INDEX_VARIABLES}
    with tempfile.TemporaryDirectory() as folder:
        locked = Path(folder) / "locked.txt"
        locked.write_text("".join(file.read_text() for file in files if file.exists()))
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


def file_of(package: str, files: list[Path], needed: dict[str, set[str]]) -> Path:
    """Return the locked file of a package; `needed` names the packages that each part needs."""
    names = {file.stem.removeprefix("locked-"): file for file in files}
    if "engine" in names:
        if package == "torch":
            return names["torch"]
        if package.startswith(ONLY_FOR_CUDA):
            return names["cuda"]
        return names[next((part for part, packages in needed.items() if package in packages), "dev")]
    # The other environments consist of one package that is installed alone, and of what it needs.
    alone = {"bpy": files[-1], "pip": files[-1]}
    return alone.get(package, files[0])


if __name__ == "__main__":
    sys.exit(main())
