"""Stored arrays are checked against the file before they are read."""

import io
import os
import struct
import sys
import zipfile

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.core.files import ArraySpec, read_array, read_arrays

MEMBERSHIP = ArraySpec("float32", ("n",), finite=True)


def npy(header: str, data: bytes = b"") -> bytes:
    text = header.encode("latin1")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def read(path):
    return read_array(path, MEMBERSHIP, advice="Isolate the object again.")


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("values", [np.arange(5, dtype=np.float32), np.zeros(0, np.float32)])
def test_an_array_comes_back(tmp_path, values, mapped):
    np.save(tmp_path / "a.npy", values)
    back = read_array(tmp_path / "a.npy", MEMBERSHIP, advice="", mapped=mapped)
    assert np.array_equal(back, values) and back.dtype == values.dtype


def test_columns_first_and_text_come_back(tmp_path):
    table = np.asfortranarray(np.arange(6, dtype=np.int32).reshape(2, 3))
    np.save(tmp_path / "t.npy", table)
    assert np.array_equal(read_array(tmp_path / "t.npy", ArraySpec("int32", (2, "n")), advice=""), table)
    np.savez(tmp_path / "s.npz", header=np.array('{"a": "é"}'))
    assert str(read_arrays(tmp_path / "s.npz", {"header": ArraySpec("str", ())}, advice="")["header"]) == '{"a": "é"}'


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "not a NumPy file"),
        (b"\x93NUMPY", "not a NumPy file"),
        (b"\x93NUMPY\x01\x00\xff\xff{}", "header is too long"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }\n"), "too large"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }\n"), "header is damaged"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (True,), }\n", b"\0" * 4), "header is damaged"),
        (npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }\n", b"\0" * 8), "header is damaged"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (('(" + "(" * 500 + "\n"), "header is damaged"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n", b"\0" * 8), "type float64, not float32"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1), }\n", b"\0" * 4), "shape 1 x 1"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }\n", b"\0" * 4), "another size"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }\n", b"\0\0\xc0\x7f"), "not finite"),
    ],
)
def test_a_damaged_array_is_one_sentence(tmp_path, content, problem):
    (tmp_path / "membership.npy").write_bytes(content)
    with pytest.raises(FormatError) as caught:
        read(tmp_path / "membership.npy")
    assert problem in str(caught.value) and str(caught.value).endswith("Isolate the object again.")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pipes among the files")
def test_a_pipe_is_one_sentence(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FormatError, match="cannot be read"):
        read(tmp_path / "pipe")


def test_a_missing_file_and_a_folder_are_one_sentence(tmp_path):
    for path in (tmp_path / "none.npy", tmp_path, tmp_path / "null\0character"):
        with pytest.raises(FormatError, match="cannot be read"):
            read(path)


def archive_of(**members: bytes) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name + ".npy", content)
    return data.getvalue()


POINTS = {"points": ArraySpec("float64", ("n", 3)), "colors": ArraySpec("uint8", ("n", 3))}


def test_arrays_of_one_file_must_have_equal_lengths(tmp_path):
    np.savez(tmp_path / "p.npz", points=np.zeros((4, 3)), colors=np.zeros((5, 3), np.uint8))
    with pytest.raises(FormatError, match="`colors`: it has the shape 5 x 3, not 4 x 3"):
        read_arrays(tmp_path / "p.npz", POINTS, advice="Run again.")


def test_only_wanted_arrays_are_decoded(tmp_path):
    np.savez(tmp_path / "p.npz", points=np.zeros((4, 3)), colors=np.zeros((4, 3), np.uint8), extra=np.zeros(2))
    found = read_arrays(tmp_path / "p.npz", POINTS, advice="", only=frozenset({"colors"}))
    assert set(found) == {"colors"}


def test_a_cut_archive_a_wrong_checksum_and_a_missing_array_are_one_sentence(tmp_path):
    path = tmp_path / "p.npz"
    np.savez(path, points=np.arange(300.0).reshape(100, 3), colors=np.zeros((100, 3), np.uint8))
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[whole.index(np.float64(150.0).tobytes()) + 6] ^= 1
    without_colors = archive_of(points=npy("{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3), }\n"))
    for content in (whole[:1000], whole[:-1], bytes(flipped), b"", b"PK\x05\x06", without_colors):
        path.write_bytes(content)
        with pytest.raises(FormatError, match="p.npz cannot be read: .*Run again."):
            read_arrays(path, POINTS, advice="Run again.")


def test_a_size_that_the_data_cannot_have_allocates_nothing(tmp_path):
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000, 3), }\n"
    (tmp_path / "p.npz").write_bytes(archive_of(points=npy(header), colors=npy(header)))
    with pytest.raises(FormatError, match="another size|too large"):
        read_arrays(tmp_path / "p.npz", POINTS, advice="")


def test_a_length_that_numpy_cannot_hold_is_one_sentence(tmp_path):
    header = "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 1" + "0" * 40 + "), }\n"
    (tmp_path / "a.npy").write_bytes(npy(header))
    with pytest.raises(FormatError, match="cannot be read"):
        read_array(tmp_path / "a.npy", ArraySpec("float32", ("n", "m")), advice="")
    (tmp_path / "a.npz").write_bytes(archive_of(a=npy(header)))
    with pytest.raises(FormatError, match="cannot be read"):
        read_arrays(tmp_path / "a.npz", {"a": ArraySpec("float32", ("n", "m"))}, advice="")


def test_a_small_archive_does_not_decode_for_minutes(tmp_path, monkeypatch):
    """Compressed zeros decode to a thousand times their size."""
    monkeypatch.setattr("engine.core.files.arrays._MAX_DEFLATED_BYTES", 1_000_000)
    np.savez_compressed(tmp_path / "p.npz", points=np.zeros((50_000, 3)), colors=np.zeros((50_000, 3), np.uint8))
    assert (tmp_path / "p.npz").stat().st_size < 4000
    with pytest.raises(FormatError, match="its compressed arrays state 0.0 GB"):
        read_arrays(tmp_path / "p.npz", POINTS, advice="")
    assert set(read_arrays(tmp_path / "p.npz", POINTS, advice="", only=frozenset({"colors"}))) == {"colors"}


def test_arrays_that_share_their_bytes_are_refused(tmp_path):
    """Thousands of members at one place would decode to thousands of times the size of the file."""
    data = io.BytesIO()
    values = npy("{'descr': '|u1', 'fortran_order': False, 'shape': (1000,), }\n", bytes(1000))
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("a.npy", values)
        first = archive.infolist()[0]
        for number in range(9):
            other = zipfile.ZipInfo(f"{number}.npy")
            other.CRC, other.compress_size, other.file_size = first.CRC, first.compress_size, first.file_size
            other.header_offset = first.header_offset
            archive.filelist.append(other)
    (tmp_path / "p.npz").write_bytes(data.getvalue())
    with pytest.raises(FormatError, match="its arrays overlap"):
        read_arrays(tmp_path / "p.npz", {}, optional={"*": ArraySpec("uint8", ("n",))}, advice="")


def test_text_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("engine.core.files.arrays._MAX_TEXT_BYTES", 100)
    np.savez(tmp_path / "s.npz", header=np.array("x" * 26))
    with pytest.raises(FormatError, match="too large"):
        read_arrays(tmp_path / "s.npz", {"header": ArraySpec("str", ())}, advice="")


def test_the_message_about_a_huge_name_is_short(tmp_path):
    whole = archive_of(**{"a" * 5000: npy("{'descr': '|u1', 'fortran_order': False, 'shape': (0,), }\n")})
    (tmp_path / "p.npz").write_bytes(whole.replace(b"aaaaa", b"aaaab", 1))
    with pytest.raises(FormatError, match="cannot be read: .*[^.]\\. Run again") as caught:
        read_arrays(tmp_path / "p.npz", {}, optional={"*": ArraySpec("uint8", ("n",))}, advice="Run again.")
    assert len(str(caught.value)) < 500
