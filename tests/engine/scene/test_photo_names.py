"""The photo that another program, a mask or a person means is found; a name that may mean several is not guessed."""

from __future__ import annotations

import unicodedata

import pytest

from engine.scene import match_names, photos_called

RIG = [f"cam{camera}/{number:04d}.jpg" for camera in (1, 2) for number in (1, 2, 3)]


@pytest.mark.parametrize(
    ("name", "photo"),
    [
        ("a/1.jpg", "a/1.jpg"),
        ("images/a/1.jpg", "a/1.jpg"),
        ("./a/1.jpg", "a/1.jpg"),
        ("D:\\scan\\a\\1.jpg", "a/1.jpg"),
        ("/scans/A/1.JPG", "a/1.jpg"),
        ("x/3", "3.png"),
        ("IMG_4.HEIC", "b/img_4.jpg"),
        ("IMG_4.PEF", "b/img_4.jpg"),
        (unicodedata.normalize("NFD", "fotos/Krüge Öl.jpg"), "Krüge Öl.jpg"),
        ("Kr%C3%BCge%20%C3%96l.jpg", "Krüge Öl.jpg"),
        ("Krüge_Öl.tif", "Krüge Öl.jpg"),
    ],
)
def test_a_name_means_the_photo_with_the_longest_equal_end(name: str, photo: str) -> None:
    photos = ["a/1.jpg", "b/1.jpg", "3.png", "b/img_4.jpg", "Krüge Öl.jpg"]
    assert match_names([name], photos).found == {name: photo}


def test_equal_numbers_in_the_folders_of_several_cameras_are_told_apart_by_the_folder() -> None:
    names = [f"images/{photo}" for photo in RIG]
    assert match_names(names, RIG).found == dict(zip(names, RIG, strict=True))


def test_a_name_that_several_photos_fit_is_matched_with_none_and_told_with_them() -> None:
    matches = match_names(["0001.jpg", "cam3/0002.jpg", "cam2/0003.jpg"], RIG)
    assert matches.found == {"cam2/0003.jpg": "cam2/0003.jpg"}
    assert matches.ambiguous["cam3/0002.jpg"] == ("cam1/0002.jpg", "cam2/0002.jpg")
    assert matches.ambiguity() == "0001.jpg may be cam1/0001.jpg or cam2/0001.jpg"
    assert photos_called("0001.jpg", RIG) == ("cam1/0001.jpg", "cam2/0001.jpg")


def test_two_names_that_fit_a_photo_equally_well_are_matched_with_none() -> None:
    matches = match_names(["left/1.jpg", "right/1.jpg"], ["1.jpg"])
    assert matches.found == {}
    assert matches.ambiguity() == "left/1.jpg and right/1.jpg may both be 1.jpg"


def test_the_more_literal_name_wins() -> None:
    assert match_names(["1.png", "1.jpg"], ["1.jpg"]).found == {"1.jpg": "1.jpg"}
    assert match_names(["1.jpg"], ["1.png", "1.JPG"]).found == {"1.jpg": "1.JPG"}
    assert photos_called("2.jpg", ["2.jpg", "old/2.jpg"]) == ("2.jpg",)


def test_what_is_no_photo_is_matched_with_none() -> None:
    matches = match_names(["scan.1.jpg", "scan.2", ""], ["scan.jpg", "scan.10.jpg", "other.jpg"])
    assert matches.found == {} and matches.ambiguous == {}
    assert photos_called("nothing.jpg", ["1.jpg"]) == ()
