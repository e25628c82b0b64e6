"""Create the Python environments of the repository and download the model files: ``make setup``.

Runs on Python 3.9 or newer with the standard library only. Creates ``.venv/engine`` and ``.venv/blender-4.5`` with
CPython 3.11, and ``.venv/blender-5.2`` if a CPython 3.13 is found. Completed steps are not repeated.

example: python scripts/setup_environments.py
"""

from __future__ import annotations

import argparse
import ctypes.util
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from places import ROOT, environment_folder, python_of
from pythons import find_python

REQUIREMENTS = ROOT / "requirements"
STAMP = "gaussian_heritage_setup.json"
MIN_FREE_GB = {"cpu": 6.0, "cuda": 14.0}
"""Free disk space required, by build of torch. Environments and model files take 4.5 GB, a CUDA build of torch takes
5 GB more, and pip needs space to unpack."""

PYTORCH_INDEX = "https://download.pytorch.org/whl/"
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
    Environment("engine", (3, 11), ("engine", "torch", "cuda"), ENGINE_IMPORTS, True),
    Environment("blender-4.5", (3, 11), ("blender-4.5", "bpy-4.5"), "import bpy, pytest", True),
    Environment("blender-5.2", (3, 13), ("blender-5.2", "bpy-5.2"), "import bpy, pytest", False),
)

ONE_INDEX = {"PIP_EXTRA_INDEX_URL": " ", "PIP_FIND_LINKS": " "}
"""Environment variables with which pip asks only the index on its command line: they replace the user's other ones. An
empty value would not."""


def main() -> int:
    """Create what is missing and return 0, or print the problem and return 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--torch", choices=("auto", "cpu", "cuda"), default="auto", help="build of torch (default: auto)"
    )
    parser.add_argument("--no-models", action="store_true", help="do not download the model files")
    options = parser.parse_args()
    try:
        torch = ("cuda" if nvidia_driver() else "cpu") if options.torch == "auto" else options.torch
        make_environments(torch)
        if not options.no_models:
            fetch_models()
    except SetupProblem as problem:
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
        if python:
            pythons[environment] = python
        elif environment.required:
            wanted = ".".join(str(part) for part in environment.python)
            raise SetupProblem(
                f"no CPython {wanted} (64 bit, with venv and pip) was found; install it from python.org or your "
                f"system's packages (Debian: python{wanted}-venv) and run `make setup` again."
            )
        elif not python_of(environment.name).exists():
            print(f"{environment.name}: skipped, because no CPython 3.13 was found; its tests will not run.")
    if not pythons:
        print("The environments are ready.", flush=True)
        return
    check_disk(torch)
    check_npm()
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
        run([python, "-m", "venv", folder], log, f"the environment {folder} could not be created")
    pip(environment, locked(environment.locked[0]), log, locked_file(environment.locked[0]).name)
    if environment.name == "engine":
        drop_other_torch(torch, log)
        install_torch(environment, torch, log)
    else:
        install_bpy(environment, log)
    run([python_of(environment.name), "-c", environment.must_import], log, f"a package of {folder} cannot be imported")
    write_stamp(folder / STAMP, {"made_from": environment.fingerprint(torch)})


def write_stamp(path: Path, stamp: dict[str, str]) -> None:
    """Write the stamp atomically, so that a killed process leaves no partial stamp."""
    temporary = path.with_suffix(".tmp")
    temporary.write_text(json.dumps(stamp), encoding="utf-8")
    os.replace(temporary, path)


def install_torch(environment: Environment, torch: str, log: Path) -> None:
    """Install the build of torch that is wanted, from one index and without any other package.

    PyPI has CUDA builds for Linux and CPU builds for macOS and Windows; their hashes are in ``locked-torch.txt``. The
    other builds come from PyTorch's own index, or from a configured index that has them. Their hashes are not known.
    """
    own: list[object] = ["--no-deps", "--only-binary", ":all:", "--index-url"]
    own += [PYTORCH_INDEX + ("cu130" if torch == "cuda" else "cpu"), pinned("torch")]
    unverified = "; its SHA-256 is not in requirements/, so it is not checked"
    if torch == "cuda" and sys.platform == "win32":
        pip(environment, own, log, f"torch (cuda) from {PYTORCH_INDEX}{unverified}", one_index=True)
        return
    if torch == "cpu":
        offered = plan(["--no-deps", "--only-binary", ":all:", pinned("torch")])
        if offered is not None and not needs_cuda(offered):
            known = sha256_of(offered) in locked_file("torch").read_text(encoding="utf-8")
            arguments: list[object] = ["--no-deps", "--only-binary", ":all:", pinned("torch")]
            arguments = locked("torch") if known else arguments
            pip(environment, arguments, log, "torch (cpu)" + ("" if known else unverified))
            return
        if plan(own, one_index=True) is not None:
            pip(environment, own, log, f"torch (cpu) from {PYTORCH_INDEX}{unverified}", one_index=True)
            return
        if offered is None:
            raise SetupProblem(
                f"neither pip's index nor {PYTORCH_INDEX}cpu offers {pinned('torch')}; check the network "
                "(proxy, firewall) and run `make setup` again."
            )
        print(f"engine: {PYTORCH_INDEX}cpu cannot be reached; installing the CUDA build (about 5 GB more)", flush=True)
        check_disk("cuda")
    pip(environment, [*locked("torch"), *locked("cuda")], log, "torch (cuda)")


def needs_cuda(offered: dict[str, Any]) -> bool:
    """Return whether the torch of pip's report requires the packages of CUDA on this computer."""
    names = offered["metadata"].get("requires_dist", [])
    return sys.platform == "linux" and any(name.startswith(("nvidia-", "triton", "cuda-")) for name in names)


def sha256_of(offered: dict[str, Any]) -> str:
    """Return the SHA-256 in pip's report of a package; a word that is no hash when the index states none."""
    return str(offered["download_info"].get("archive_info", {}).get("hashes", {}).get("sha256", "unknown"))


def install_bpy(environment: Environment, log: Path) -> None:
    """Install ``bpy`` without any other package, from the configured index or, if that does not have it, Blender's."""
    name = environment.locked[1]
    found = plan(["--no-deps", "--only-binary", ":all:", pinned(name)], python_of(environment.name)) is not None
    index = [] if found else ["--index-url", BLENDER_INDEX]
    pip(environment, [*locked(name), *index], log, locked_file(name).name, one_index=not found)


def drop_other_torch(torch: str, log: Path) -> None:
    """Uninstall the other build of torch, because pip takes 2.13.0+cpu and 2.13.0+cu130 for the same version."""
    code = "import torch; print('cpu' if torch.version.cuda is None else 'cuda')"
    python = python_of("engine")
    answer = subprocess.run([str(python), "-c", code], capture_output=True, text=True, check=False)
    if answer.returncode == 0 and answer.stdout.strip() != torch:
        print(f"engine: torch is built for {answer.stdout.strip()}, {torch} is wanted", flush=True)
        run([python, "-m", "pip", "uninstall", "--yes", "torch"], log, "the other torch could not be removed")


def plan(arguments: list[object], python: Path | None = None, *, one_index: bool = False) -> dict[str, Any] | None:
    """Return pip's report of the one package that it would install, None when it finds none. The timeout is 20 s."""
    command = [python or python_of("engine"), "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet"]
    command += ["--report", "-", "--retries", "1", "--timeout", "20", *arguments]
    answer = subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **(ONE_INDEX if one_index else {})},
    )
    if answer.returncode:
        return None
    offered: dict[str, Any] = json.loads(answer.stdout)["install"][0]
    return offered


def locked(name: str) -> list[object]:
    """Return pip's arguments to install a locked file: nothing that is not in it, and only what has its hash."""
    return ["--require-hashes", "--no-deps", "--only-binary", ":all:", "--requirement", locked_file(name)]


def pip(environment: Environment, arguments: list[object], log: Path, what: str, *, one_index: bool = False) -> None:
    """Install packages into an environment and print each download."""
    print(f"{environment.name}: installing {what} (details: {log})", flush=True)
    command = [python_of(environment.name), "-m", "pip", "install", "--no-input", "--progress-bar", "off", *arguments]
    problem = "pip could not install the packages; check the network and the disk"
    run(command, log, problem, show="Downloading ", variables=ONE_INDEX if one_index else {})


def run(
    command: list[object], log: Path, problem: str, show: str = "\0", variables: dict[str, str] | None = None
) -> None:
    """Run a command and log its output; raise `SetupProblem` with the last error line when it fails.

    Lines that begin with `show` are printed too. `variables` are added to the environment variables.
    """
    last = ""
    with (
        log.open("a", encoding="utf-8") as record,
        subprocess.Popen(
            [str(part) for part in command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            env={**os.environ, **(variables or {})},
        ) as process,
    ):
        assert process.stdout is not None
        for line in process.stdout:
            record.write(line)
            if line.strip().startswith(show):
                print("   ", line.strip(), flush=True)
            if "ERROR" in line or "Error" in line or not last:
                last = line.strip()
    if process.returncode:
        raise SetupProblem(f"{problem}: {last} (details: {log}).")


def fetch_models() -> None:
    """Download the missing model files with the engine, which checks their hashes."""
    fetched = subprocess.run([python_of("engine"), "-m", "engine", "models", "fetch"], cwd=ROOT, check=False)
    if fetched.returncode:
        raise SetupProblem("the model files could not be downloaded (see above); run `make setup` again.")


def check_disk(torch: str) -> None:
    """Raise `SetupProblem` when the disk has too little free space."""
    folder = environment_folder("engine")
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free / 1e9
    if free < MIN_FREE_GB[torch]:
        raise SetupProblem(f"{folder} has {free:.1f} GB free and set-up needs {MIN_FREE_GB[torch]:.0f} GB; free some.")


def check_npm() -> None:
    """Raise `SetupProblem` when Node is missing: npm provides the mask model, and tests validate glTF with node."""
    for program in ("node", "npm"):
        if shutil.which(program) is None:
            raise SetupProblem(f"`{program}` was not found; install Node 18 or newer (nodejs.org) and try again.")


def nvidia_driver() -> bool:
    """Return whether this computer has an NVIDIA driver."""
    if sys.platform == "darwin":
        return False
    library = "nvcuda" if sys.platform == "win32" else "cuda"
    return shutil.which("nvidia-smi") is not None or ctypes.util.find_library(library) is not None


def works(python: Path, version: tuple[int, int]) -> bool:
    """Return whether an environment's Python starts and has the version and pip."""
    if not python.exists():
        return False
    code = f"import sys, pip; sys.exit(sys.version_info[:2] != {version})"
    return subprocess.run([str(python), "-c", code], capture_output=True, check=False).returncode == 0


def pinned(name: str) -> str:
    """Return name and version of the only package of a locked file."""
    lines = locked_file(name).read_text(encoding="utf-8").splitlines()
    return next(line for line in lines if "==" in line).rstrip(" \\")


def locked_file(name: str) -> Path:
    """Return the path of ``requirements/locked-<name>.txt``."""
    return REQUIREMENTS / f"locked-{name}.txt"


if __name__ == "__main__":
    sys.exit(main())
