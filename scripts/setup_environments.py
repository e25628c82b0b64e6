"""Create the Python environments of the repository and download the model files: ``make setup``.

Runs on Python 3.9 or newer with the standard library only. Creates ``.venv/engine`` and an environment for each Blender
of `places.BLENDERS`; those after the first only if their Python is found. Completed steps are not repeated.

example: python scripts/setup_environments.py
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import json
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from places import BLENDERS, ROOT, environment_folder, python_of

sys.path.insert(0, str(ROOT))
from engine.core.errors import HeritageError  # noqa: E402 it imports the standard library alone
from engine.core.system import package_system, replace_file, run_text  # noqa: E402 as above
from engine.install.environment import (  # noqa: E402 as above
    Pip,
    default_build,
    find_python,
    locked_arguments,
    pinned,
    run_logged,
    torch_source,
)

ENGINE_REQUIREMENTS = ROOT / "engine" / "install" / "environment"
REQUIREMENTS = ROOT / "requirements"
STAMP = "gaussian_heritage_setup.json"
MIN_FREE_GB = {"cpu": 6.0, "cuda": 14.0}
"""Free disk space required with one Blender, by build of torch. Environments and model files take 4.5 GB, a CUDA build
of torch takes 5 GB more, and pip needs space to unpack."""

FURTHER_BLENDER_GB = 1.1
"""Disk space of each further Blender."""

DOWNLOADED_GB = {"cpu": 0.9, "cuda": 3.4}
"""What the environment of the engine downloads with its model files, by build of torch; each Blender is 0.4 more."""

BLENDER_LIBRARIES = {
    "libX11.so.6": "libx11-6", "libXext.so.6": "libxext6", "libXfixes.so.3": "libxfixes3", "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1", "libICE.so.6": "libice6", "libSM.so.6": "libsm6", "libGL.so.1": "libgl1",
    "libxkbcommon.so.0": "libxkbcommon0",
}  # fmt: skip
"""Libraries of a Linux desktop that Blender is linked with, and the packages of Debian and Ubuntu that have them."""

BLENDER_INDEX = "https://download.blender.org/pypi/"


class SetupProblem(Exception):
    """A reason why the environments cannot be created, as a sentence."""


@dataclass(frozen=True)
class Environment:
    """Name of an environment (its folder in ``.venv``), its Python version, packages and a check of its imports.

    `locked` names the files ``requirements/locked-*.txt`` that define its packages.
    """

    name: str
    python: tuple[int, int]
    locked: tuple[str, ...]
    must_import: str
    required: bool

    def files(self) -> list[Path]:
        """Return the files that define the packages of the environment."""
        return [locked_file(name) for name in self.locked]

    def fingerprint(self, torch: str) -> str:
        """Return the hash of everything that defines the environment."""
        digest = hashlib.sha256(repr((self.python, torch if self.name == "engine" else "")).encode())
        for file in self.files():
            # Read as text, because line ends differ between checkouts on Windows and elsewhere.
            digest.update(file.read_text(encoding="utf-8").encode())
        return digest.hexdigest()

    def is_ready(self, torch: str) -> bool:
        """Return whether the environment exists and was created from the current requirement files."""
        try:
            stamp = json.loads((environment_folder(self.name) / STAMP).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        return stamp == {"made_from": self.fingerprint(torch)} and python_of(self.name).exists()


ENGINE_IMPORTS = "import torch, pycolmap, onnxruntime, cv2, numba, scipy, PIL, tokenizers, pytest"
ENVIRONMENTS = (
    Environment(
        "engine", (3, 11), ("engine", "serve", "batch", "formats", "dev", "torch", "cuda"), ENGINE_IMPORTS, True
    ),
    *(
        Environment(
            f"blender-{version}", python, (f"blender-{version}", f"bpy-{version}"), "import bpy, pytest", not at
        )
        for at, (version, python) in enumerate(BLENDERS.items())
    ),
)


def main() -> int:
    """Create what is missing and return 0, or print the problem and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--torch", choices=("auto", "cpu", "cuda"), default="auto", help="build of torch (default: auto)"
    )
    parser.add_argument("--no-models", action="store_true", help="do not download the model files")
    options = parser.parse_args()
    try:
        torch = default_build() if options.torch == "auto" else options.torch
        make_environments(torch)
        if not options.no_models:
            fetch_models()
    except (SetupProblem, HeritageError) as problem:
        print(f"\nSet-up stopped: {problem}", file=sys.stderr)
        return 1
    return 0


def make_environments(torch: str) -> None:
    """Create every environment that is not ready."""
    pythons = {}
    for environment in ENVIRONMENTS:
        if environment.is_ready(torch):
            continue
        python = find_python(environment.python)
        wanted = ".".join(str(part) for part in environment.python)
        if python:
            pythons[environment] = python
        elif environment.required:
            raise SetupProblem(
                f"no CPython {wanted} (64 bit, with venv and pip) was found; install it from python.org or your "
                f"system's packages (Debian: python{wanted}-venv) and run the same command again."
            )
        elif not python_of(environment.name).exists():
            print(
                f"{environment.name}: skipped, because no CPython {wanted} was found. That is fine: only the tests in "
                "this Blender need it.",
                flush=True,
            )
    if not pythons:
        print("The environments are ready.", flush=True)
        return
    check_disk(torch, n_blenders=sum(one.name != "engine" for one in pythons))
    check_libraries()
    size = sum(DOWNLOADED_GB[torch] if one.name == "engine" else 0.4 for one in pythons)
    print(f"Up to {size:.1f} GB are downloaded; a set-up that was stopped continues when it is run again.", flush=True)
    for environment, python in pythons.items():
        started = time.monotonic()
        make(environment, python, torch)
        print(f"{environment.name}: ready after {time.monotonic() - started:.0f} s", flush=True)


def make(environment: Environment, python: Path, torch: str) -> None:
    """Create or update an environment. Its stamp is written last, so that a stopped run is repeated."""
    folder = environment_folder(environment.name)
    log = folder.parent / f"{environment.name}.log"
    (folder / STAMP).unlink(missing_ok=True)
    if not works(python_of(environment.name), environment.python):
        print(f"{environment.name}: a new environment from {python}", flush=True)
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        run_logged([python, "-m", "venv", folder], log, f"the environment {folder} could not be created")
    for name in (
        ("engine", "serve", "batch", "formats", "dev") if environment.name == "engine" else environment.locked[:1]
    ):
        pip(environment, locked_arguments(locked_file(name)), log, locked_file(name).name)
    if environment.name == "engine":
        drop_other_torch(torch, log)
        install_torch(environment, torch, log)
    else:
        install_bpy(environment, log)
    run_logged(
        [python_of(environment.name), "-c", environment.must_import], log, f"a package of {folder} cannot be imported"
    )
    write_stamp(folder / STAMP, {"made_from": environment.fingerprint(torch)})


def write_stamp(path: Path, stamp: dict[str, str]) -> None:
    """Write the stamp atomically, so that a killed process leaves no partial stamp."""
    temporary = path.with_suffix(".tmp")
    temporary.write_text(json.dumps(stamp), encoding="utf-8")
    replace_file(temporary, path)


def install_torch(environment: Environment, torch: str, log: Path) -> None:
    """Install the build of torch that is wanted, or else the one that can be reached."""
    source = torch_source(Pip(python_of(environment.name), log), torch)
    if source.build != torch:
        print("engine: only a CUDA build of torch can be reached (about 5 GB more)", flush=True)
        check_disk(source.build)
    pip(environment, list(source.arguments), log, source.what, one_index=source.one_index)


def install_bpy(environment: Environment, log: Path) -> None:
    """Install ``bpy`` without any other package, from the configured index or, if that does not have it, Blender's."""
    file = locked_file(environment.locked[1])
    found = Pip(python_of(environment.name), log).offered(["--no-deps", "--only-binary", ":all:", pinned(file)])
    index: list[object] = [] if found is not None else ["--index-url", BLENDER_INDEX]
    pip(environment, [*locked_arguments(file), *index], log, file.name, one_index=found is None)


def drop_other_torch(torch: str, log: Path) -> None:
    """Uninstall the other build of torch, because pip takes 2.13.0+cpu and 2.13.0+cu130 for the same version."""
    code = "import torch; print('cpu' if torch.version.cuda is None else 'cuda')"
    python = python_of("engine")
    answer = run_text([python, "-c", code])
    if answer.returncode == 0 and answer.stdout.strip() != torch:
        print(f"engine: torch is built for {answer.stdout.strip()}, {torch} is wanted", flush=True)
        Pip(python, log).uninstall("torch")


def pip(environment: Environment, arguments: list[object], log: Path, what: str, *, one_index: bool = False) -> None:
    """Install packages into an environment and print each download."""
    print(f"{environment.name}: installing {what} (details: {log})", flush=True)
    Pip(python_of(environment.name), log).install(arguments, one_index=one_index, on_line=show_download)


def show_download(line: str) -> None:
    """Print a line of pip's output about a download."""
    if line.strip().startswith("Downloading "):
        print("   ", line.strip(), flush=True)


def fetch_models() -> None:
    """Download the missing model files with the engine, which checks their hashes."""
    fetched = subprocess.run([python_of("engine"), "-m", "engine", "models", "fetch"], cwd=ROOT, check=False)
    if fetched.returncode:
        raise SetupProblem("the model files could not be downloaded (see above); run the same command again.")


def check_disk(torch: str, n_blenders: int = 1) -> None:
    """Raise `SetupProblem` when the disk has too little free space."""
    needed = MIN_FREE_GB[torch] + FURTHER_BLENDER_GB * max(0, n_blenders - 1)
    folder = environment_folder("engine")
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free / 1e9
    if free < needed:
        raise SetupProblem(f"{folder} has {free:.1f} GB free and set-up needs {needed:.0f} GB; free some.")


def check_libraries() -> None:
    """Raise `SetupProblem` when a Linux without a desktop lacks what Blender is linked with."""
    if not package_system().startswith("linux"):
        return
    missing = []
    for name in BLENDER_LIBRARIES:
        try:
            ctypes.CDLL(name)
        except OSError:
            missing.append(name)
    if missing:
        packages = " ".join(BLENDER_LIBRARIES[name] for name in missing)
        raise SetupProblem(
            f"Blender needs {', '.join(missing)}, which every Linux with a desktop has; install them (Debian, Ubuntu: "
            f"sudo apt-get install {packages}) and run the same command again."
        )


def works(python: Path, version: tuple[int, int]) -> bool:
    """Return whether an environment's Python starts and has the version and pip."""
    if not python.exists():
        return False
    code = f"import sys, pip; sys.exit(sys.version_info[:2] != {version})"
    return subprocess.run([str(python), "-c", code], capture_output=True, check=False).returncode == 0


def locked_file(name: str) -> Path:
    """Return the path of ``locked-<name>.txt``: the engine's own in its package, the others in ``requirements``."""
    return next(
        file for folder in (ENGINE_REQUIREMENTS, REQUIREMENTS) if (file := folder / f"locked-{name}.txt").exists()
    )


if __name__ == "__main__":
    sys.exit(main())
