"""True masks come out the same whatever layout they are shipped in, and a wrong layout is said in a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import FormatError, MaskError
from engine.masks.mask_metrics import iou
from engine.quality.evaluation.ground_truth import GroundTruth, _Photos, read_ground_truth
from tests.engine.museum import VIEWS
from tests.engine.quality.evaluation.layouts import as_3d_ovs, as_lerf_mask, as_lerf_ovs, as_museum, photo, true_masks

PHOTOS = [photo(view) for view in VIEWS]
TRUE_VIEWS = VIEWS[1::2]
TRAIN_VIEWS = VIEWS[::2]
MAKERS: dict[str, Callable[[Path], Path]] = {
    "museum": lambda folder: as_museum(folder / "truth", TRUE_VIEWS),
    "lerf-mask": lambda folder: as_lerf_mask(folder / "truth", TRUE_VIEWS, TRAIN_VIEWS),
    "3d-ovs": lambda folder: as_3d_ovs(folder / "truth", TRUE_VIEWS, VIEWS),
    "lerf-ovs": lambda folder: as_lerf_ovs(folder / "label" / "room", TRUE_VIEWS),
}


@pytest.fixture(params=sorted(MAKERS))
def truth(request: pytest.FixtureRequest, tmp_path: Path) -> GroundTruth:
    found = read_ground_truth(MAKERS[request.param](tmp_path), PHOTOS)
    assert found.layout == request.param
    return found


def test_every_layout_gives_the_same_masks(truth: GroundTruth) -> None:
    assert truth.photos == tuple(photo(view) for view in TRUE_VIEWS)
    assert {"teapot", "vase"} <= set(truth.objects) and truth.prompts["vase"] == "vase"
    for view in TRUE_VIEWS:
        masks = truth.masks(photo(view))
        expected = {name: mask for name, mask in true_masks(view).items() if mask.any()}
        assert "teapot" in expected and set(expected) == set(masks) & {"teapot", "vase"}
        for name, mask in expected.items():
            height, width = masks[name].shape
            shrunk = masks[name][height // 300 :: height // 150, width // 400 :: width // 200]
            # A polygon has no hole where the teapot's handle has one; nothing else differs.
            assert (shrunk | ~mask).all()
            assert iou(shrunk, mask) > (0.85 if truth.layout == "lerf-ovs" else 0.999)


def test_only_instance_ids_say_what_every_pixel_shows(truth: GroundTruth) -> None:
    assert truth.every_pixel == (truth.layout == "museum")


def test_views_without_a_camera_are_named(tmp_path: Path) -> None:
    for name, make in MAKERS.items():
        unregistered = PHOTOS[1]
        truth = read_ground_truth(make(tmp_path / name), PHOTOS[2:], [PHOTOS[0], unregistered])
        assert truth.unplaced == (unregistered,) and truth.photos == (PHOTOS[3],), name


def test_views_may_be_called_like_their_photos(tmp_path: Path) -> None:
    folder = as_lerf_mask(tmp_path, TRUE_VIEWS, TRAIN_VIEWS)
    for number, view in enumerate(TRUE_VIEWS):
        (folder / "test_mask" / str(number)).rename(folder / "test_mask" / f"view_{view:02}")
    assert read_ground_truth(folder / "test_mask", PHOTOS).photos == tuple(photo(view) for view in TRUE_VIEWS)


def test_numbered_views_need_what_they_count(tmp_path: Path) -> None:
    folder = as_lerf_mask(tmp_path, TRUE_VIEWS, TRAIN_VIEWS)
    (folder / "images_train").rename(folder / "elsewhere")
    with pytest.raises(FormatError, match="put that folder beside test_mask"):
        read_ground_truth(folder, PHOTOS)


def test_more_views_than_photos_are_refused(tmp_path: Path) -> None:
    folder = as_3d_ovs(tmp_path, TRUE_VIEWS, VIEWS)
    (folder / "segmentations" / "03").rename(folder / "segmentations" / "30")
    with pytest.raises(FormatError, match="masks for view 30, but there are only 5"):
        read_ground_truth(folder, PHOTOS)


def test_missing_class_is_named(tmp_path: Path) -> None:
    folder = as_3d_ovs(tmp_path, TRUE_VIEWS, VIEWS)
    (folder / "segmentations" / "01" / "vase.png").unlink()
    with pytest.raises(FormatError, match=r"vase\.png is missing, but .* lists it"):
        read_ground_truth(folder, PHOTOS)


def test_folder_without_masks_says_what_is_read(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no known layout .museum: masks/ and names.json; lerf-mask"):
        read_ground_truth(tmp_path, PHOTOS)
    with pytest.raises(FormatError, match="is not a folder"):
        read_ground_truth(tmp_path / "nothing", PHOTOS)


@pytest.mark.parametrize("layout", ["museum", "lerf-mask", "3d-ovs", "lerf-ovs"])
def test_wrong_layout_is_refused(layout: str, tmp_path: Path) -> None:
    other = MAKERS["lerf-ovs" if layout != "lerf-ovs" else "museum"](tmp_path)
    (other / "masks").mkdir(exist_ok=True)
    with pytest.raises(FormatError):
        read_ground_truth(other if layout != "lerf-ovs" else other / "masks", PHOTOS, layout=layout)


def test_equal_objects_share_a_prompt_and_keep_their_own_masks(tmp_path: Path) -> None:
    folder = as_museum(tmp_path / "truth", TRUE_VIEWS)
    before = read_ground_truth(folder, PHOTOS)
    names = json.loads((folder / "names.json").read_text(encoding="utf-8"))
    for entry in names.values():
        entry["prompt"] = "exhibit"
    (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")
    truth = read_ground_truth(folder, PHOTOS)
    assert truth.objects == before.objects and set(truth.prompts.values()) == {"exhibit"}
    view = truth.photos[0]
    assert {name: mask.sum() for name, mask in truth.masks(view).items()} == {
        name: mask.sum() for name, mask in before.masks(view).items()
    }


def test_two_objects_of_one_name_are_refused(tmp_path: Path) -> None:
    folder = as_museum(tmp_path, TRUE_VIEWS)
    twins = {"1": {"prompt": "vase"}, "2": {"prompt": "vase"}}
    (folder / "names.json").write_text(json.dumps(twins), encoding="utf-8")
    with pytest.raises(FormatError, match=r"names\.json calls several objects 'vase'"):
        read_ground_truth(folder, PHOTOS)


def test_ignored_things_are_no_objects_and_keep_their_masks(tmp_path: Path) -> None:
    folder = as_museum(tmp_path, TRUE_VIEWS)
    before = read_ground_truth(folder, PHOTOS)
    names = json.loads((folder / "names.json").read_text(encoding="utf-8"))
    names["2"]["ignore"] = True
    names["3"] = {"name": "teapot", "prompt": "obelisk", "ignore": True}
    (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")
    truth = read_ground_truth(folder, PHOTOS)
    assert truth.ignored == ("teapot",) and set(before.objects) - set(truth.objects) == {"teapot", "obelisk"}
    assert not {"teapot", "obelisk"} & set(truth.prompts.values())
    for photo_name in truth.photos:
        masks, all_masks = truth.masks(photo_name), before.masks(photo_name)
        assert set(masks) == set(all_masks) - {"teapot", "obelisk"}
        # Ignored things of one name are one.
        (ignored,) = truth.ignored_masks(photo_name).values()
        assert np.array_equal(ignored, all_masks["teapot"] | all_masks.get("obelisk", False))
        assert before.ignored_masks(photo_name) == {}


def test_absent_things_are_read_where_they_are_listed(tmp_path: Path) -> None:
    folder = as_museum(tmp_path, TRUE_VIEWS)
    assert read_ground_truth(folder, PHOTOS).absent == ()
    (folder / "absent.json").write_text('["dog", "piano", "dog"]', encoding="utf-8")
    assert read_ground_truth(folder, PHOTOS).absent == ("dog", "piano")
    for text in ('["dog", "vase"]', '{"dog": 1}', "[1]", "["):
        (folder / "absent.json").write_text(text, encoding="utf-8")
        with pytest.raises(FormatError, match=r"absent\.json .*must be a list of texts"):
            read_ground_truth(folder, PHOTOS)


def test_object_called_like_an_ignored_thing_is_refused(tmp_path: Path) -> None:
    folder = as_museum(tmp_path, TRUE_VIEWS)
    for names, told in (
        ({"1": {"prompt": "vase"}, "2": {"prompt": "vase", "ignore": True}}, "calls several objects 'vase'"),
        ({"1": {"prompt": "vase", "ignore": True}}, "names no object to evaluate"),
        ({"1": {"prompt": "vase", "ignore": "yes"}}, "must be of the form"),
    ):
        (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")
        with pytest.raises(FormatError, match=told):
            read_ground_truth(folder, PHOTOS)


def test_masks_of_other_photos_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"no masks for the photos of this project \(it has: view_07, view_09\)"):
        read_ground_truth(MAKERS["museum"](tmp_path), ["IMG_1.jpg"])


def test_masks_are_found_by_the_ends_of_paths(tmp_path: Path) -> None:
    photos = _Photos(["cam1/0001.JPG", "cam2/0001.JPG", "0002.jpg"], [])
    assert [photos.called(view) for view in ("cam2/0001", "0002.png", "9")] == ["cam2/0001.JPG", "0002.jpg", "9"]


def test_two_photos_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="several photos have that name"):
        read_ground_truth(MAKERS["museum"](tmp_path), ["left/view_07.jpg", "right/view_07.jpg"])


def test_damaged_files_are_named(tmp_path: Path) -> None:
    folder = as_museum(tmp_path / "museum", TRUE_VIEWS)
    (folder / "masks" / "view_07.png").write_bytes(b"\x89PNG")
    with pytest.raises(MaskError, match=r"view_07\.png cannot be read"):
        read_ground_truth(folder, PHOTOS).masks("view_07.jpg")
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / "masks" / "view_07.png")
    with pytest.raises(MaskError, match="colour picture"):
        read_ground_truth(folder, PHOTOS).masks("view_07.jpg")
    labels = as_lerf_ovs(tmp_path / "label", TRUE_VIEWS)
    (labels / "view_07.json").write_text('{"info": {}}', encoding="utf-8")
    with pytest.raises(FormatError, match=r"view_07\.json cannot be read: .* A label of LERF-OVS"):
        read_ground_truth(labels, PHOTOS)
    (folder / "names.json").write_text("[]", encoding="utf-8")
    with pytest.raises(FormatError, match=r"names\.json .*must be of the form"):
        read_ground_truth(folder, PHOTOS)


@pytest.mark.parametrize(
    "text",
    [
        '{"x": {"prompt": "vase"}}', '{"-1": {"prompt": "vase"}}', '{"1": {"prompt": 7}}', '{"1": "vase"}',
        "[" * 100_000,
        '{"' + "9" * 5000 + '": {"prompt": "vase"}}', "\ufeff{", '{"1": {"prompt": "\\ud800"}}',
    ],
    ids=range(8),
)  # fmt: skip
def test_names_of_another_form_are_one_sentence(tmp_path: Path, text: str) -> None:
    folder = as_museum(tmp_path / "museum", TRUE_VIEWS)
    (folder / "names.json").write_text(text, encoding="utf-8")
    with pytest.raises(FormatError, match=r"names\.json .*must be of the form"):
        read_ground_truth(folder, PHOTOS)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("height", 10**9),
        ("height", 0),
        ("width", -5),
        ("width", 1e9),
        ("name", None),
        ("segmentation", [[1, 2], [3]]),
        ("segmentation", [[1, "a"]]),
        ("segmentation", [[1e30, 2], [3, 4], [5, 6]]),
        ("segmentation", [[None, 2], [3, 4]]),
        ("segmentation", {}),
        ("category", 7),
    ],
)
def test_a_label_that_cannot_be_drawn_is_one_sentence(tmp_path: Path, place: str, value: object) -> None:
    labels = as_lerf_ovs(tmp_path / "label", TRUE_VIEWS)
    file = labels / "view_07.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    (data["objects"][0] if place in ("segmentation", "category") else data["info"])[place] = value
    file.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(FormatError, match=r"view_07\.json cannot be read"):
        read_ground_truth(labels, PHOTOS)


def test_a_mask_of_too_many_pixels_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = as_museum(tmp_path / "museum", TRUE_VIEWS)
    monkeypatch.setattr("engine.quality.evaluation.ground_truth._MAX_PIXELS", 100)
    monkeypatch.setattr(Image.Image, "convert", None)
    with pytest.raises(MaskError, match=r"view_07\.png cannot be read: it has \d+ x \d+ pixels"):
        read_ground_truth(folder, PHOTOS).masks("view_07.jpg")


@pytest.mark.parametrize("line", ["../vase", "/vase", "a\0b", "vase\xff"])
def test_a_class_that_names_another_folder_is_refused(tmp_path: Path, line: str) -> None:
    folder = MAKERS["3d-ovs"](tmp_path)
    listed = next(folder.rglob("classes.txt"))
    listed.write_bytes(line.encode("latin-1"))
    with pytest.raises(FormatError, match=r"classes\.txt"):
        read_ground_truth(folder, PHOTOS)
