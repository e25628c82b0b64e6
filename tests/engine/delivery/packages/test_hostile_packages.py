"""Packages that somebody made to do harm are refused with a sentence, and nothing outside of them is touched."""

from __future__ import annotations

import hashlib
import os
import struct
import zipfile
from pathlib import Path

import pytest

from engine.core.errors import FormatError
from engine.delivery.packages.verification import verify_package


def write_small_bag(folder: Path) -> Path:
    """Write a bag with one file."""
    (folder / "data").mkdir(parents=True)
    (folder / "data" / "a.txt").write_bytes(b"one")
    (folder / "bagit.txt").write_text("BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n")
    digest = hashlib.sha256(b"one").hexdigest()
    (folder / "manifest-sha256.txt").write_text(f"{digest}  data/a.txt\n")
    return folder


def write_small_zip(path: Path, name: str = "bag/data/a.txt", data: bytes = b"one", **changes: object) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bag/bagit.txt", "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n")
        archive.writestr("bag/manifest-sha256.txt", f"{hashlib.sha256(b'one').hexdigest()}  data/a.txt\n")
        info = zipfile.ZipInfo(name)
        for key, value in changes.items():
            setattr(info, key, value)
        archive.writestr(info, data, zipfile.ZIP_DEFLATED)
    return path


def test_bag_of_another_program_is_accepted(tmp_path: Path) -> None:
    assert verify_package(write_small_bag(tmp_path / "bag")).is_intact
    assert verify_package(write_small_zip(tmp_path / "bag.zip")).is_intact


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "data/../../secret", "data\\..\\secret", "bagit.txt", ""])
def test_list_that_names_a_file_outside_is_refused(tmp_path: Path, name: str) -> None:
    bag = write_small_bag(tmp_path / "bag")
    (tmp_path / "secret").write_text("x")
    (bag / "manifest-sha256.txt").write_text(f"{'0' * 64}  {name}\n")
    with pytest.raises(FormatError, match="names no file of the package"):
        verify_package(bag)


def test_link_in_a_package_is_refused(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag")
    (bag / "data" / "b.txt").symlink_to("/etc/passwd")
    with pytest.raises(FormatError, match="is a link"):
        verify_package(bag)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_pipe_in_a_package_does_not_hang(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag")
    os.mkfifo(bag / "data" / "b.txt")
    with pytest.raises(FormatError, match="a link or a device"):
        verify_package(bag)


@pytest.mark.parametrize(
    "name",
    [
        "../a.txt", "/a.txt", "bag/../../a.txt", "C:/a.txt",
        pytest.param(
            "bag/data\\a.txt",
            marks=pytest.mark.skipif(os.sep == "\\", reason="zipfile reads it as a name inside of the package there"),
        ),
    ],
)  # fmt: skip
def test_zip_with_a_name_that_leads_out_is_refused(tmp_path: Path, name: str) -> None:
    path = write_small_zip(tmp_path / "bag.zip", "bag/data/NAME.txt")
    data = path.read_bytes().replace(b"bag/data/NAME.txt", name.encode().ljust(17, b"x"))
    path.write_bytes(data)
    with pytest.raises(FormatError):
        verify_package(path)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["bag.zip"]


def test_zip_with_a_link_is_refused(tmp_path: Path) -> None:
    path = write_small_zip(tmp_path / "bag.zip", data=b"/etc/passwd", external_attr=0o120777 << 16)
    with pytest.raises(FormatError, match="is a link"):
        verify_package(path)


def test_zip_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path: Path) -> None:
    path = write_small_zip(tmp_path / "bomb.zip", data=bytes(200 << 20))
    assert path.stat().st_size < 1 << 20
    with pytest.raises(FormatError, match="far more than a package does"):
        verify_package(path)


def test_zip_whose_files_overlap_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("bag/data/a.txt", bytes(1000))
    data = bytearray(path.read_bytes())
    place = data.index(b"PK\x01\x02")
    entry, end = bytes(data[place : data.index(b"PK\x05\x06")]), data.index(b"PK\x05\x06")
    entries = b"".join(entry.replace(b"a.txt", f"{n}.txt".encode()) for n in range(10))
    tail = bytearray(data[end:])
    struct.pack_into("<HHI", tail, 8, 10, 10, len(entries))
    path.write_bytes(bytes(data[:place]) + entries + bytes(tail))
    with pytest.raises(FormatError):
        verify_package(path)


def test_same_file_twice_in_a_zip_is_refused(tmp_path: Path) -> None:
    path = write_small_zip(tmp_path / "bag.zip")
    with pytest.warns(UserWarning), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("bag/data/a.txt", "two")
    with pytest.raises(FormatError, match="not allowed"):
        verify_package(path)


@pytest.mark.parametrize("keep", [0, 10, 100, -30, -1])
def test_truncated_zip_is_refused(tmp_path: Path, keep: int) -> None:
    path = write_small_zip(tmp_path / "bag.zip")
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(FormatError):
        verify_package(path)


@pytest.mark.parametrize(
    "text", ["", "BagIt-Version: 9.9\n", "BagIt-Version: 1.0\nTag-File-Character-Encoding: EBCDIC\n"]
)
def test_unknown_versions_and_encodings_are_refused(tmp_path: Path, text: str) -> None:
    bag = write_small_bag(tmp_path / "bag")
    (bag / "bagit.txt").write_text(text)
    with pytest.raises(FormatError, match="bagit.txt"):
        verify_package(bag)


def test_weak_hashes_and_files_in_the_web_are_refused(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag")
    (bag / "fetch.txt").write_text("http://example.org/a 3 data/a.txt\n")
    with pytest.raises(FormatError, match="in the web"):
        verify_package(bag)
    (bag / "fetch.txt").unlink()
    (bag / "manifest-sha256.txt").rename(bag / "manifest-md5.txt")
    with pytest.raises(FormatError, match="no list of SHA-256"):
        verify_package(bag)


def test_folder_that_is_no_package_is_said(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="has no bagit.txt"):
        verify_package(tmp_path)
    with pytest.raises(FormatError, match="cannot be read"):
        verify_package(tmp_path / "none")
