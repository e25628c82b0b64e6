"""A package holds everything that a person needs, and says what changed in it."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import cv2
import pytest
from PIL import Image

from engine.delivery.packages import page
from engine.delivery.packages.verification import verify_package
from engine.project.folder import ProjectFolder
from tests.engine.command_line import call
from tests.engine.pictures.blob_scene import BlobScene

from .conftest import TITLE, make_project


@pytest.fixture(scope="package", autouse=True)
def viewer(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A small stand-in for the viewer, which npm builds; tests/web opens pages with the real one."""
    import gzip

    folder = tmp_path_factory.mktemp("viewer")
    (folder / "show.js").write_text("const one = 1;")
    (folder / "show.css").write_text("body{}")
    (folder / "viewer.js.gz").write_bytes(gzip.compress(b"export const createViewer = 1;"))
    (folder / "licences.txt").write_text("viewer 1 (MIT)")
    patch = pytest.MonkeyPatch()
    patch.setattr(page, "_VIEWER", folder)
    yield
    patch.undo()


@pytest.fixture(scope="package")
def package(project: ProjectFolder, tmp_path_factory: pytest.TempPathFactory, viewer: None) -> Path:
    from engine.delivery.packages.package import write_package

    return write_package(tmp_path_factory.mktemp("out"), project, "kanne", address="https://example.org/")


def test_package_has_open_files_records_pictures_and_a_readme(package: Path) -> None:
    names = {path.relative_to(package).as_posix() for path in package.rglob("*") if path.is_file()}
    assert {
        "bagit.txt", "bag-info.txt", "manifest-sha256.txt", "tagmanifest-sha256.txt", "data/README.txt",
        "data/ro-crate-metadata.json", "data/kanne.ply", "data/kanne.glb", "data/kanne.html",
        "data/records/paradata.json", "data/records/provenance.jsonld", "data/records/dublin_core.xml",
        "data/records/lido.xml", "data/iiif/manifest.json", "data/pictures/contact_sheet.png",
        "data/pictures/turntable.webm", "data/pictures/turntable.mp4", "data/pictures/view_00.jpg",
    } <= names  # fmt: skip
    readme = (package / "data" / "README.txt").read_text(encoding="utf-8")
    assert readme.startswith(f"{TITLE}\n1906.12\nCC BY 4.0, Musée\n")
    assert "unit of length is not known" in readme
    assert "view" in readme and "kanne.glb" in readme


def test_bagit_accepts_the_package(package: Path) -> None:
    if importlib.util.find_spec("bagit") is None:
        pytest.skip("The library bagit is installed by hand: it has no wheel (`pip install bagit`).")
    import bagit

    assert bagit.Bag(str(package)).validate()


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum, which Windows lacks")
def test_sha256sum_accepts_the_package(package: Path) -> None:
    done = subprocess.run(["sha256sum", "--check", "--quiet", "manifest-sha256.txt"], cwd=package, check=False)
    assert done.returncode == 0


def test_crate_describes_every_file_with_its_size_and_hash(package: Path) -> None:
    data = package / "data"
    graph = {
        one["@id"]: one for one in json.loads((data / "ro-crate-metadata.json").read_text(encoding="utf-8"))["@graph"]
    }
    assert graph["./"]["name"] == TITLE and graph["./"]["identifier"][0] == "1906.12"
    for path in data.rglob("*"):
        name = path.relative_to(data).as_posix()
        if path.is_file() and name != "ro-crate-metadata.json":
            assert graph[name]["contentSize"] == str(path.stat().st_size)
            assert f"{graph[name]['sha256']}  data/{name}" in (package / "manifest-sha256.txt").read_text(
                encoding="utf-8"
            )
    steps = [one for one in graph.values() if one["@type"] == "CreateAction"]
    assert len(steps) == 3 and all(step["instrument"] for step in steps)


def test_rocrate_reads_the_crate_again(package: Path) -> None:
    from rocrate.rocrate import ROCrate

    assert ROCrate(package / "data").name == TITLE


def test_pictures_turn_and_the_films_show_them(package: Path) -> None:
    pictures = package / "data" / "pictures"
    views = sorted(pictures.glob("view_*.jpg"))
    assert len(views) == 36
    manifest = json.loads((package / "data" / "iiif" / "manifest.json").read_text(encoding="utf-8"))
    assert len(manifest["items"]) == 36
    with Image.open(views[0]) as first:
        size = first.size
    assert size == (manifest["items"][0]["width"], manifest["items"][0]["height"])
    paradata = json.loads((package / "data" / "records" / "paradata.json").read_text(encoding="utf-8"))
    # Not all photos see the ball whole, so that the pictures span the angle of those that do, there and back.
    assert not paradata["pictures"]["photos_surround_it"] and 40 <= paradata["pictures"]["degrees"] < 360
    for name in ("turntable.webm", "turntable.mp4"):
        film = cv2.VideoCapture(str(pictures / name))
        count = 0
        while film.read()[0]:
            count += 1
        assert count == 72 + 70


def test_records_in_the_package_can_be_read(package: Path) -> None:
    records = package / "data" / "records"
    for name in ("lido.xml", "dublin_core.xml"):
        ET.parse(records / name)
    links = [one.text or "" for one in ET.parse(records / "lido.xml").iter("{http://www.lido-schema.org}linkResource")]
    assert len(links) >= 4 and all((records / link).is_file() for link in links)
    for name in ("paradata.json", "provenance.jsonld"):
        json.loads((records / name).read_text(encoding="utf-8"))
    assert (
        json.loads((records / "paradata.json").read_text(encoding="utf-8"))["captures"][0]["exif"]["camera_model"]
        == "Phone 3"
    )


def test_page_escapes_what_a_curator_wrote(package: Path) -> None:
    text = (package / "data" / "kanne.html").read_text(encoding="utf-8")
    assert "<b>" not in text.replace("<b>&amp;</b>", "") or "&lt;b&gt;" in text
    assert "&lt;b&gt;&amp;amp;&lt;/b&gt;" in text
    assert "second\\x07 line" in text
    assert "default-src &#x27;none&#x27;" in text and "http://" not in text.split("<script")[0]


def test_untouched_package_is_accepted_and_every_change_is_named(package: Path, tmp_path: Path) -> None:
    import shutil

    copy = tmp_path / "kanne"
    shutil.copytree(package, copy)
    assert verify_package(copy).is_intact
    ply = copy / "data" / "kanne.ply"
    ply.write_bytes(ply.read_bytes()[:-1] + b"\xff")
    (copy / "data" / "records" / "lido.xml").unlink()
    (copy / "data" / "new.txt").write_text("new")
    (copy / "bag-info.txt").write_text("Bagging-Date: 1999-01-01\n")
    found = verify_package(copy)
    assert (found.changed, found.missing, found.added) == (
        ("data/kanne.ply", "bag-info.txt"),
        ("data/records/lido.xml",),
        ("data/new.txt",),
    )


def test_zip_is_verified_without_unpacking(project: ProjectFolder, tmp_path: Path) -> None:
    from engine.delivery.packages.package import write_package

    path = write_package(tmp_path, project, "kanne", address="https://example.org/kanne/", as_zip=True)
    assert path == tmp_path / "kanne.zip"
    assert verify_package(path).is_intact
    assert sorted(one.name for one in tmp_path.iterdir()) == ["kanne.zip"]
    changed = tmp_path / "changed.zip"
    with zipfile.ZipFile(path) as before, zipfile.ZipFile(changed, "w") as after:
        assert b">../kanne.ply<" in before.read("kanne/data/records/lido.xml")
        for name in before.namelist():
            data = before.read(name)
            after.writestr(name, data + b" " if name.endswith("README.txt") else data)
    assert verify_package(changed).changed == ("data/README.txt",)


def test_scene_package_has_its_report_in_every_language(
    blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = make_project(blobs, tmp_path / "Antikensaal")
    pages = {"report.html": "Report", "report_de.html": "Bericht"}
    (project.path / "report").mkdir(exist_ok=True)
    for name, text in pages.items():
        (project.path / "report" / name).write_text(text)
    assert call(capsys, "package", project.path, "--scene", "--out", tmp_path / "out").code == 0
    package = tmp_path / "out" / "antikensaal"
    assert {name: (package / "data" / name).read_text(encoding="utf-8") for name in pages} == pages
    readme = (package / "data" / "README.txt").read_text(encoding="utf-8")
    assert re.search(r"report\.html .*\(English\)", readme) and re.search(r"report_de\.html .*\(Deutsch\)", readme)
    assert verify_package(package).is_intact


def test_scene_package_has_its_photos_when_wanted(
    blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = make_project(blobs, tmp_path / "Antikensaal")
    words = ("package", project.path, "--scene", "--with-photos", "--out", tmp_path / "out")
    assert call(capsys, *words).code == 0
    data = tmp_path / "out" / "antikensaal" / "data"
    assert (data / "photos" / "view_0.png").read_bytes() == (tmp_path / "Antikensaal/photos/view_0.png").read_bytes()
    assert verify_package(tmp_path / "out" / "antikensaal").is_intact
    assert "already exists" in call(capsys, *words).error
    (tmp_path / "Antikensaal" / "photos" / "view_0.png").unlink()
    assert "view_0.png" in call(capsys, *words, "--overwrite").error
    assert verify_package(tmp_path / "out" / "antikensaal").is_intact, "the package of before is kept"


def test_folder_that_is_no_package_is_never_replaced(
    project: ProjectFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "kanne").mkdir()
    (tmp_path / "kanne" / "letter.txt").write_text("mine")
    error = call(capsys, "package", project.path, "--out", tmp_path, "--overwrite").error
    assert "is no package" in error
    assert (tmp_path / "kanne" / "letter.txt").read_text(encoding="utf-8") == "mine"


def test_verify_command_names_what_changed(package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import shutil

    copy = tmp_path / "kanne"
    shutil.copytree(package, copy)
    answer = call(capsys, "verify", copy)
    assert answer.code == 0
    assert "Nothing changed" in answer.of_kind("finished")[0]["message"]
    (copy / "data" / "README.txt").write_text("other")
    answer = call(capsys, "verify", copy)
    assert "not as it was made: 1 changed" in answer.error
    assert [one["message"] for one in answer.of_kind("warning")] == ["data/README.txt was changed."]


def test_address_that_is_none_and_object_without_gaussians_are_refused(
    project: ProjectFolder, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("package", project.path, "--out", tmp_path / "out")
    assert "is no address" in call(capsys, *words, "--address", "museum").error
    import numpy as np

    from engine.project.objects import ObjectRecord, save_object

    other = make_project(blobs, tmp_path / "other")
    record = ObjectRecord("none", "None", {"kind": "click"}, 0.5, 1.0, 1.0, 0, len(blobs.part))
    save_object(other.path, record, np.zeros(len(blobs.part), np.float32))
    error = call(capsys, "package", other.path, "--object", "none", "--out", tmp_path / "out").error
    assert "has no Gaussians" in error
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True


def test_turntable_command_writes_sheet_and_films(
    project: ProjectFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("turntable", project.path, "--object", "kanne", "--out", tmp_path / "pictures")
    assert call(capsys, *words).code == 0
    names = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert names == ["contact_sheet.png", "turntable.mp4", "turntable.webm"]
    assert "already exists" in call(capsys, *words).error


def test_page_without_the_built_viewer_says_how_to_get_it(
    project: ProjectFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "_VIEWER", tmp_path / "none")
    out = tmp_path / "a.html"
    error = call(capsys, "export", project.path, "--format", "html", "--out", out).error
    assert "make page" in error and not out.exists()
