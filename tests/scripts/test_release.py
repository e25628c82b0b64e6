"""What `make release` writes: the same bytes each time, complete, and of a commit only."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from engine import __version__
from engine.install.models import CATALOGUE
from tests.contracts.test_requirements import pins
from tests.engine.command_line import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

import make_release  # noqa: E402


def test_repository_has_the_version_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    for name in ("first", "again"):
        make_release.extension_repository(tmp_path / name)
    files = sorted(file.name for file in (tmp_path / "first").iterdir())
    assert files == [f"gaussian_heritage-{__version__}.zip", "index.json"]
    for file in files:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "again" / file).read_bytes()
    (entry,) = json.loads((tmp_path / "first" / "index.json").read_text(encoding="utf-8"))["data"]
    assert (entry["version"], entry["archive_url"]) == (__version__, f"./{files[0]}")


def test_container_recipe_has_all_that_its_containerfile_copies(tmp_path: Path) -> None:
    out = tmp_path / "recipe.tar.gz"
    make_release.container_recipe(out)
    with tarfile.open(out) as archive:
        names = {Path(name).relative_to(Path(name).parts[0]).as_posix() for name in archive.getnames()}
    sent = [
        line[1:] for line in (ROOT / ".containerignore").read_text(encoding="utf-8").splitlines() if line[:1] == "!"
    ]
    assert {"Containerfile", "compose.yaml", ".containerignore", *sent} <= names
    assert not [name for name in names if name.startswith(("tests", "docs", "demo"))]


def test_sbom_is_valid_and_lists_what_is_installed(tmp_path: Path) -> None:
    make_release.write_sbom(tmp_path / "sbom.json")
    parts = json.loads((tmp_path / "sbom.json").read_text(encoding="utf-8"))["components"]
    scopes = {part["name"]: part.get("scope") for part in parts}
    engine = {name for file in ("locked-engine", "locked-torch", "locked-pip") for name in pins(file)}
    assert engine <= {name for name, scope in scopes.items() if scope == "required"}
    assert set(pins("locked-cuda")) - engine == {name for name, scope in scopes.items() if scope == "optional"}
    models = {part["name"] for part in parts if part["type"] == "machine-learning-model"}
    assert models == {model.name for model in CATALOGUE.values() if not model.optional}
    assert "playcanvas" in scopes and all(part["licenses"] for part in parts)


def test_sbom_that_the_schema_refuses_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_release, "sbom", lambda: {"bomFormat": "CycloneDX", "specVersion": "1.6", "components": 1})
    with pytest.raises(make_release.ReleaseProblem, match="the SBOM is not valid"):
        make_release.write_sbom(tmp_path / "sbom.json")
    assert not (tmp_path / "sbom.json").exists()


def test_checksums_name_every_file_as_sha256sum_reads_them(tmp_path: Path) -> None:
    (tmp_path / "repository").mkdir()
    for name in ("b.zip", "repository/a.zip", make_release.CHECKSUMS):
        (tmp_path / name).write_bytes(name.encode())
    names = ("b.zip", "repository/a.zip")
    expected = "".join(f"{hashlib.sha256(name.encode()).hexdigest()}  {name}\n" for name in names)
    assert make_release.checksums(tmp_path) == expected


def test_checkout_with_changes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_release, "ROOT", tmp_path)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    make_release.require_commit()
    (tmp_path / "new.py").write_text("", encoding="utf-8")
    with pytest.raises(make_release.ReleaseProblem, match=r"made of a commit(.|\n)*new\.py"):
        make_release.require_commit()


def test_bundle_that_cannot_be_made_is_told_by_its_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sentence of the engine, such as one about a registry that does not answer."""
    program = tmp_path / "python.py"
    program.write_text(
        "#!/usr/bin/env python3\nimport sys\n"
        "if 'macos' in sys.argv: sys.exit('Error: The registry has no packages for macOS.')\n",
        encoding="utf-8",
    )
    program.chmod(0o755)
    monkeypatch.setattr(make_release, "python_of", lambda name: program)
    assert [problem.partition(": ")[2] for problem in make_release.offline_bundles(tmp_path)] == [
        "The registry has no packages for macOS."
    ] * 2
