"""Make the files of a release in ``dist/release``: ``make release``. Nothing is tagged or uploaded.

``repository`` is a static extension repository for Blender: the extension and ``index.json``. Beside it are offline
bundles for each system and each Python of `places.BLENDERS`, what the container image is built from, the SBOM of the
engine and ``SHA256SUMS``. A release is made of a commit: the same commit gives the same bytes again, where the
registries offer the same files.

example: python scripts/make_release.py --without-bundles
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from places import BLENDERS, ROOT, python_of

sys.path.insert(0, str(ROOT))
from build_extension import build, run_tool  # noqa: E402 it needs the line above
from container.sbom import model_files, page_packages  # noqa: E402 as above
from licences import GROUPS, LICENCES, locked_packages  # noqa: E402 as above

from engine import __version__  # noqa: E402 as above
from engine.core.files import file_sha256  # noqa: E402 as above
from engine.core.system import SYSTEMS  # noqa: E402 as above

NAME = f"gaussian_heritage-{__version__}"
CHECKSUMS = "SHA256SUMS"
RECIPE = ("Containerfile", "compose.yaml", "compose.gpu.yaml", ".containerignore")
"""What is needed to build the image beside what ``.containerignore`` lets through."""
VIEWER_LICENCES = ROOT / "engine" / "delivery" / "packages" / "viewer_files" / "licences.txt"


class ReleaseProblem(Exception):
    """A reason why a file of the release cannot be made, as a sentence."""


def main() -> int:
    """Make all files, list them, and return 0; return 1 when one of them could not be made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "release", help="emptied (default: %(default)s)")
    parser.add_argument("--without-bundles", action="store_true", help="no offline bundles, of which each has 0.6 GB")
    options = parser.parse_args()
    out: Path = options.out.resolve()
    try:
        require_commit()
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        extension_repository(out / "repository")
        container_recipe(out / f"{NAME}-container.tar.gz")
        write_sbom(out / f"{NAME}-sbom.cdx.json")
    except ReleaseProblem as problem:
        print(f"The release was not made: {problem}", file=sys.stderr)
        return 1
    missing = [] if options.without_bundles else offline_bundles(out)
    (out / CHECKSUMS).write_text(checksums(out), encoding="utf-8")
    print(listing(out))
    for sentence in missing:
        print(f"\nNot in this release: {sentence}", file=sys.stderr)
    return int(bool(missing))


def require_commit() -> None:
    """Raise `ReleaseProblem` where the checkout differs from its commit."""
    done = subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode or done.stdout:
        changed = f"{done.stdout}{done.stderr}".strip()
        raise ReleaseProblem(f"a release is made of a commit, and {ROOT} has changes; commit them first:\n{changed}")


def extension_repository(folder: Path) -> None:
    """Write the extension's zip and Blender's index of it; the folder is served as it is, under any address.

    Raises
    ------
    ReleaseProblem
        When Blender's tool refuses the extension.
    """
    problem = build(folder / f"{NAME}.zip") or run_tool("server-generate", "--repo-dir", folder)
    if problem:
        raise ReleaseProblem(problem)


def container_recipe(out: Path) -> None:
    """Write the files of the commit from which ``podman build`` makes the image.

    Raises
    ------
    ReleaseProblem
        When git cannot read them.
    """
    lines = (ROOT / ".containerignore").read_text(encoding="utf-8").splitlines()
    names = [*RECIPE, *(line[1:] for line in lines if line.startswith("!"))]
    command = ["git", "archive", "--format=tar.gz", f"--prefix={NAME}-container/", f"--output={out}", "HEAD", *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseProblem(f"git could not write {out.name}: {done.stderr.strip()}")


def offline_bundles(out: Path) -> list[str]:
    """Write an offline bundle for each system and each Python of Blender; return a sentence for each that failed."""
    problems = []
    for version in sorted({".".join(str(part) for part in python) for python in BLENDERS.values()}):
        for system in SYSTEMS:
            file = out / f"{NAME}-offline-{system}-python{version}.zip"
            command = [python_of("engine"), "-m", "engine.install.environment", "bundle", file]
            done = subprocess.run(
                [*map(str, command), "--system", system, "--python-version", version],
                cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False,
            )  # fmt: skip
            if done.returncode:
                last = [line for line in done.stderr.splitlines() if line][-1:]
                problems.append(f"{file.name}: {''.join(last).removeprefix('Error: ')}")
            else:
                print(f"{file.name} is ready.", flush=True)
    return problems


def write_sbom(out: Path) -> None:
    """Write the SBOM, checked against the schema of CycloneDX.

    Raises
    ------
    ReleaseProblem
        When the schema refuses it.
    """
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    text = json.dumps(sbom(), indent=1) + "\n"
    if problem := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        raise ReleaseProblem(f"the SBOM is not valid: {problem}")
    out.write_text(text, encoding="utf-8")


def sbom() -> dict[str, Any]:
    """Return what the extension contains and what its engine installs, as CycloneDX 1.6.

    Packages have no hashes here: the locked files, which the installation checks, list one for each file of a package.
    """
    program = {
        "type": "application", "bom-ref": "gaussian-heritage", "name": "gaussian-heritage", "version": __version__,
        "licenses": [{"license": {"id": "GPL-3.0-or-later"}}],
    }  # fmt: skip
    parts = [*python_packages(), *page_packages(VIEWER_LICENCES), *model_files()]
    return {
        "bomFormat": "CycloneDX", "specVersion": "1.6", "version": 1, "metadata": {"component": program},
        "components": parts,
        "dependencies": [{"ref": program["bom-ref"], "dependsOn": [part["bom-ref"] for part in parts]}],
    }  # fmt: skip


def python_packages() -> Iterator[dict[str, Any]]:
    """Yield the packages that the engine installs; those for NVIDIA cards are optional."""
    from cyclonedx import spdx

    licences: dict[str, str] = json.loads(LICENCES.read_text(encoding="utf-8"))
    needed = set(locked_packages(GROUPS["The engine"][1]))
    for package in sorted(needed.union(locked_packages(GROUPS["NVIDIA's libraries"][1]))):
        name, _, version = package.partition("==")
        licence, url = licences[package], f"pkg:pypi/{name}@{version}"
        stated: dict[str, Any] = {"license": {"name": licence}}
        if spdx.is_supported_id(licence):
            stated = {"license": {"id": licence}}
        elif spdx.is_expression(licence) and " " in licence:
            stated = {"expression": licence}
        yield {
            "type": "library", "bom-ref": url, "name": name, "version": version, "purl": url,
            "scope": "required" if package in needed else "optional", "licenses": [stated],
        }  # fmt: skip


def checksums(folder: Path) -> str:
    """Return the SHA-256 of each file below a folder, as ``sha256sum --check`` reads them."""
    files = sorted(file for file in folder.rglob("*") if file.is_file() and file.name != CHECKSUMS)
    return "".join(f"{file_sha256(file)}  {file.relative_to(folder).as_posix()}\n" for file in files)


def listing(folder: Path) -> str:
    """Return the files with their sizes in MB and hashes, as text."""
    rows = (line.split("  ") for line in (folder / CHECKSUMS).read_text(encoding="utf-8").splitlines())
    return "\n".join(f"{(folder / name).stat().st_size / 1e6:8.2f} MB  {sha256}  {name}" for sha256, name in rows)


if __name__ == "__main__":
    sys.exit(main())
