"""The licence of everything that is bundled or installed is told in docs/licences.md."""

from __future__ import annotations

import json
import sys
from email.parser import Parser

import pytest

from engine.install.models import CATALOGUE
from tests.engine.command_line import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

import licences  # noqa: E402

DOCUMENT = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
KNOWN = json.loads(licences.LICENCES.read_text(encoding="utf-8"))


def test_no_locked_package_is_missing_and_none_is_told_that_is_not_locked() -> None:
    """After `make lock`, `python scripts/licences.py` writes both files anew."""
    locked_files = {
        file.stem.removeprefix("locked-")
        for folder in (ROOT / "requirements", ROOT / "engine" / "install" / "environment")
        for file in folder.glob("locked-*.txt")
    }
    assert {name for _, names in licences.GROUPS.values() for name in names} == locked_files
    assert set(KNOWN) == set(licences.locked_packages(locked_files))


def test_document_has_each_package_model_file_and_part_of_the_page() -> None:
    told = dict.fromkeys(package.replace("==", " ") for package in KNOWN)
    rows = [row.split(" | ")[1] for row in DOCUMENT.splitlines() if row.startswith("| ")]
    packages = {package for row in rows for package in row.rstrip(" |").split(", ")}
    assert set(told) <= packages
    assert all(f"| {name} |" in DOCUMENT for name in CATALOGUE)
    page = json.loads((ROOT / "engine" / "serve" / "page" / "package.json").read_text(encoding="utf-8"))
    assert {f"{name} {version}" for name, version in page["dependencies"].items()} <= packages


@pytest.mark.parametrize(
    ("metadata", "text", "licence"),
    [
        ("License-Expression: MIT OR Apache-2.0\nLicense: other", "", "MIT OR Apache-2.0"),
        ("Classifier: License :: OSI Approved :: MIT License", "", "MIT"),
        ("License: BSD-3-Clause\nClassifier: License :: OSI Approved :: BSD License", "", "BSD-3-Clause"),
        ("License: MIT License\n  \n  Copyright, and the text of the licence, which is longer than a name", "", "MIT"),
        ("Name: silent", "BSD 2-Clause License\n\nCopyright", "BSD-2-Clause"),
        ("Name: silent", "All rights reserved", licences.NOT_STATED),
    ],
)
def test_licence_is_the_one_that_the_package_states(metadata: str, text: str, licence: str) -> None:
    assert licences.stated_licence(Parser().parsestr(metadata), [text]) == licence
