"""Write ``requirements/licences.json`` and ``docs/licences.md``: the licence of each locked package and model file.

The licences are those that the packages state. Packages that no environment of this computer has are downloaded, those
for CUDA among them (3 GB), unless the file has them already. Run it after ``make lock`` and ``make page``.

example: python scripts/licences.py
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Iterable, Mapping
from email.message import Message
from email.parser import Parser
from importlib import metadata
from pathlib import Path

from places import BLENDERS, ROOT, python_of

sys.path.insert(0, str(ROOT))
from container.sbom import LICENCE_FILE, page_packages  # noqa: E402 it imports the engine

from engine.install.environment import locked_file  # noqa: E402 it imports the standard library alone
from engine.install.models import CATALOGUE  # noqa: E402 as above

LICENCES = ROOT / "requirements" / "licences.json"
DOCUMENT = ROOT / "docs" / "licences.md"
PAGE_LICENCES = ROOT / "engine" / "serve" / "page" / "dist" / "licences.txt"

GROUPS = {
    "The engine": ("Installed by *Set Up Engine*, and in the offline bundles.", ("engine", "torch", "pip")),
    "NVIDIA's libraries": ("Only installed with the build of PyTorch for NVIDIA cards.", ("cuda",)),
    "Web server, batches, USD and SPZ 4": (
        "Only installed for those; the first are in the container image.", ("serve", "batch", "formats"),
    ),
    "Development": (
        "Tests, checks and builds; in no file of a release.",
        ("dev", "node", "sbom", *(f"{part}-{version}" for version in BLENDERS for part in ("blender", "bpy"))),
    ),
}  # fmt: skip
"""Title of each group: who gets its packages, and the locked files that name them."""

DATA = {
    "engine/core/words/imagenet_classes.txt, engine/core/words/broader_words.txt": ("WordNet 3.0 and 3.1", "WordNet"),
    "engine/core/words/foreign_words.txt": ("Ding 1.9 and FreeDict 2022.04.21", "GPL-2.0-or-later"),
    "engine/core/words/picture_words.txt, engine/objects/grounding/picture_features.npy": (
        "what a classifier makes of pictures of Tux Paint stamps 2022.06.04 (GPL-2.0-or-later) and of Microsoft's "
        "Fluent Emoji (MIT), with names of Unicode CLDR 48.2 (Unicode-3.0)", "GPL-2.0-or-later, MIT, Unicode-3.0",
    ),
}  # fmt: skip
"""Data of others in the repository: file, where it is from, and its licence. The text files have the notices."""

SPDX = {
    "Apache Software License": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "Apache 2.0": "Apache-2.0",
    "Apache 2.0 License": "Apache-2.0",
    "BSD License": "BSD",
    "BSD 2-Clause License": "BSD-2-Clause",
    "BSD 3-Clause License": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "BSD-3": "BSD-3-Clause",
    "MIT License": "MIT",
    "ISC License (ISCL)": "ISC",
    "ISC license": "ISC",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "MPL2": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0-only",
    "GNU General Public License v2 (GPLv2)": "GPL-2.0-only",
    "GNU General Public License v3 or later (GPLv3+)": "GPL-3.0-or-later",
    "Other/Proprietary License": "proprietary",
    "NVIDIA Proprietary Software": "proprietary",
    "The Unlicense (Unlicense)": "Unlicense",
}
"""What packages write instead of an SPDX identifier. "BSD" does not say which of its forms."""

NOT_STATED = "not stated"
_PIN = re.compile(r"^([\w.-]+)(?:\[[^]]*\])?==([\w.]+)", re.MULTILINE)
_LONGEST = 60
"""Longest text of the field ``License`` that is a name; longer ones are the text of the licence."""


def main() -> int:
    """Write both files and return 0."""
    kept: dict[str, str] = json.loads(LICENCES.read_text(encoding="utf-8")) if LICENCES.is_file() else {}
    installed = installed_licences()
    packages = sorted({package for names in GROUPS.values() for package in locked_packages(names[1])})
    found = {
        package: installed.get(package) or kept.get(package) or downloaded_licence(package) for package in packages
    }
    LICENCES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    DOCUMENT.write_text(document(found), encoding="utf-8")
    unstated = [package for package, licence in found.items() if licence == NOT_STATED]
    print(f"{LICENCES} and {DOCUMENT}: {len(found)} packages; no licence is stated by: {', '.join(unstated) or 'none'}")
    return 0


def locked_packages(names: Iterable[str]) -> list[str]:
    """Return ``package==version`` for each package of some locked files, sorted."""
    files = [locked_file(name) for name in names]
    files = [file if file.is_file() else ROOT / "requirements" / file.name for file in files]
    return sorted({f"{name}=={version}" for file in files for name, version in _PIN.findall(file.read_text("utf-8"))})


def installed_licences() -> dict[str, str]:
    """Return the licence of each package of the engine's environment and of those of Blender."""
    folders = [str(folder) for version in BLENDERS for folder in _packages_of(f"blender-{version}")]
    found = {}
    for one in [*metadata.distributions(path=folders), *metadata.distributions()]:
        fields = Parser().parsestr(one.read_text("METADATA") or "")
        texts = [Path(str(one.locate_file(file))) for file in one.files or [] if LICENCE_FILE.search(str(file))]
        # PyTorch's own builds have a local version, such as 2.13.0+cpu.
        package = f"{_normal(one.metadata['Name'])}=={one.version.partition('+')[0]}"
        found[package] = stated_licence(fields, (text.read_text("utf-8", "replace") for text in texts))
    return found


def _packages_of(environment: str) -> list[Path]:
    return sorted(python_of(environment).parent.parent.glob("[Ll]ib/**/site-packages"))


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def downloaded_licence(package: str) -> str:
    """Return the licence that a package states which this computer does not have."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary", ":all:", "--quiet"]
        subprocess.run([*command, "--no-input", "--dest", folder, package], check=True)
        with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as wheel:
            names = [name for name in wheel.namelist() if ".dist-info/" in name]
            texts = {name: wheel.read(name).decode("utf-8", "replace") for name in names}
        fields = Parser().parsestr(next(text for name, text in texts.items() if name.endswith("/METADATA")))
        return stated_licence(fields, (text for name, text in texts.items() if LICENCE_FILE.search(name)))


def stated_licence(fields: Message, texts: Iterable[str]) -> str:
    """Return the licence that a package states.

    Parameters
    ----------
    fields : Message
        The metadata of the package.
    texts : iterable of str
        Its licence files, whose first line may be the name of a licence; asked where the metadata state none.
    """
    if expression := fields.get("License-Expression"):
        return str(expression)
    classifiers = [str(line).split(" :: ") for line in fields.get_all("Classifier") or []]
    names = [parts[-1] for parts in classifiers if parts[0] == "License" and parts[-1] != "OSI Approved"]
    stated = str(fields.get("License") or "").strip()
    if stated and names in ([], ["BSD License"]):
        first = stated.splitlines()[0]
        names = [first] if len(stated) <= _LONGEST or first in SPDX else names
    if not names:
        names = [name for text in texts if (name := text.strip().partition("\n")[0].strip()) in SPDX][:1]
    return " or ".join(SPDX.get(name, name) for name in names) or NOT_STATED


def licences_of_page() -> dict[str, str]:
    """Return the licence of each package of npm whose code is in the built web page; exported pages have some."""
    return {
        f"{one['name']}=={one['version']}": one["licenses"][0]["license"]["id"] for one in page_packages(PAGE_LICENCES)
    }


def document(licences: Mapping[str, str]) -> str:
    """Return the text of docs/licences.md."""
    lines = ["# Licences of what is bundled or installed", ""]
    lines += ["Written by `python scripts/licences.py`, from the locked files, the metadata of the packages and the"]
    lines += ["catalogue of model files. Gaussian Heritage itself is GPL-3.0-or-later. Licences are those that the"]
    lines += ["packages state; *BSD* is one that does not say which form. The engine's wheels of PyAV and pillow-heif"]
    lines += [
        "contain FFmpeg, x264, x265, libheif and libde265 (LGPL-3.0 and GPL-2.0-or-later). The container image has"
    ]
    lines += ["the texts of all licences in `licences.txt`.", "", "## Model files", ""]
    lines += ["The engine fetches the first ones at set-up, and the others only when a user asks for them by name.", ""]
    lines += ["| file | fetched | licence | who may use it |", "| --- | --- | --- | --- |"]
    for model in sorted(CATALOGUE.values(), key=lambda model: model.optional):
        lines.append(
            f"| {model.name} | {'by name' if model.optional else 'at set-up'} | {model.licence} | {model.who_may_use} |"
        )
    lines += ["", "## Data of others in the engine", "", "| file | from | licence |", "| --- | --- | --- |"]
    lines += [f"| {file} | {source} | {licence} |" for file, (source, licence) in DATA.items()]
    lines += ["", "## Code in the web page and in exported pages", ""]
    lines += table(licences_of_page())
    told: set[str] = set()
    for title, (who, names) in GROUPS.items():
        group = {package: licences[package] for package in locked_packages(names) if package not in told}
        told |= set(group)
        lines += ["", f"## {title}", "", who, "", *table(group)]
    return "\n".join(lines) + "\n"


def table(licences: Mapping[str, str]) -> list[str]:
    """Return the lines of a table with a row for each licence."""
    by_licence: dict[str, list[str]] = defaultdict(list)
    for package, licence in licences.items():
        by_licence[licence].append(package.replace("==", " "))
    rows = sorted(by_licence.items(), key=lambda row: (-len(row[1]), row[0]))
    return ["| licence | packages |", "| --- | --- |", *(f"| {name} | {', '.join(them)} |" for name, them in rows)]


if __name__ == "__main__":
    sys.exit(main())
