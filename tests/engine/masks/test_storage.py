"""Label maps on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import DiskError, MaskError
from engine.masks.storage import label_map_path, read_label_map, read_recipe, write_label_map


@pytest.mark.parametrize("top", [0, 1, 255, 256, 65_535, 65_536])
def test_label_map_is_read_as_it_was_written(tmp_path: Path, top: int) -> None:
    labels = np.array([[0, top, 0], [top // 2, 0, top]], np.int32)
    path = label_map_path(tmp_path, "room one/a.jpg")
    write_label_map(path, labels, recipe="abc")
    read = read_label_map(path)
    assert read.dtype == np.int32 and np.array_equal(read, labels) and read_recipe(path) == "abc"
    assert path == tmp_path / "room one" / "a.jpg.npz"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.jpg.npz"]


def test_photos_that_differ_in_suffix_have_two_label_maps(tmp_path: Path) -> None:
    assert label_map_path(tmp_path, "a.jpg") != label_map_path(tmp_path, "a.png")


def test_unusable_file_gives_a_readable_error_and_has_no_recipe(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with pytest.raises(MaskError, match="missing"):
        read_label_map(path)
    write_label_map(path, np.zeros((50, 50), np.int32), recipe="r")
    whole = path.read_bytes()
    for damaged in (b"", whole[:40], whole[:-30], b"PNG" + whole):
        path.write_bytes(damaged)
        if damaged.endswith(whole):
            continue  # a zip may have bytes before it
        with pytest.raises(MaskError, match="Delete it and run `reconstruct` again"):
            read_label_map(path)
        assert read_recipe(path) is None
    np.savez(path, other=np.zeros(3))
    with pytest.raises(MaskError, match="cannot be read"):
        read_label_map(path)


def test_arrays_that_are_not_labels_are_rejected(tmp_path: Path) -> None:
    for labels in (np.zeros((2, 2)), np.zeros(4, np.int32), np.full((2, 2), -1, np.int32)):
        with pytest.raises(MaskError, match="label map"):
            write_label_map(tmp_path / "a.npz", labels)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_folder_that_cannot_be_written_is_a_disk_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(DiskError):
        write_label_map(tmp_path / "file" / "a.npz", np.zeros((2, 2), np.int32))


def npz(path: Path, labels: np.ndarray, header: object = '{"version": 1, "recipe": "r"}') -> None:
    np.savez(path, labels=labels, header=np.array(header))


GOOD = np.array([[0, 1], [2, 1]], np.int32)


@pytest.mark.parametrize(
    ("labels", "header"),
    [
        (np.zeros(4, np.int32), None),
        (np.zeros((2, 2, 2), np.int32), None),
        (np.zeros((2, 2), np.int64), None),
        (np.zeros((0, 5), np.int32), None),
        (np.array([["a"]]), None),
        (-GOOD, None),
        (GOOD * 2**29, None),  # a count of each segment would take gigabytes
        (GOOD, "{"),
        (GOOD, "[" * 100_000),
        (GOOD, '{"version": "1", "recipe": "r"}'),
        (GOOD, '{"version": 1, "recipe": 7}'),
        (GOOD, '{"version": 2, "recipe": "r"}'),
        (GOOD, 7),
    ],
)
def test_a_file_that_is_no_label_map_is_one_sentence(tmp_path: Path, labels: np.ndarray, header: object) -> None:
    path = tmp_path / "a.npz"
    npz(path, GOOD)
    assert np.array_equal(read_label_map(path), GOOD) and read_recipe(path) == "r"
    npz(path, labels) if header is None else npz(path, labels, header)
    with pytest.raises(MaskError, match=r"a\.npz .*Delete it and run `reconstruct` again"):
        read_label_map(path)
    if header is not None:
        assert read_recipe(path) is None


def test_a_label_map_that_decodes_to_gigabytes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.core.files.arrays._MAX_DEFLATED_BYTES", 1 << 20)
    write_label_map(tmp_path / "a.npz", np.zeros((1000, 1000), np.int32), recipe="r")
    assert (tmp_path / "a.npz").stat().st_size < 10_000
    with pytest.raises(MaskError, match="its compressed arrays state"):
        read_label_map(tmp_path / "a.npz")


def test_label_maps_of_photos_with_the_longest_names_are_stored(tmp_path: Path) -> None:
    photos = ["花" * 83 + end for end in ("aa.jpg", "ab.jpg")]
    for number, photo in enumerate(photos):
        write_label_map(label_map_path(tmp_path, photo), np.full((2, 3), number, np.int32))
    assert [read_label_map(label_map_path(tmp_path, photo))[0, 0] for photo in photos] == [0, 1]
