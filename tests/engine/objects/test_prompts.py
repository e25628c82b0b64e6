from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFile

from engine.core.errors import MaskError, PromptError
from engine.objects.prompts import (
    BoxPrompt,
    ClickPrompt,
    MaskPrompt,
    TextPrompt,
    camera_of_prompt,
    describe_prompt,
    load_mask,
    parse_prompt,
)
from tests.engine.pictures.blob_scene import BlobScene


def test_forms_of_the_command_line_are_read() -> None:
    assert parse_prompt(click="IMG_1.jpg=364,500.5") == ClickPrompt("IMG_1.jpg", 364, 500.5)
    assert parse_prompt(click="a=b/IMG.jpg=1,2") == ClickPrompt("a=b/IMG.jpg", 1, 2)
    assert parse_prompt(box="IMG_1.jpg=30,40,10,20") == BoxPrompt("IMG_1.jpg", 10, 20, 30, 40)
    assert parse_prompt(mask="IMG_1.jpg=mask.png") == MaskPrompt("IMG_1.jpg", Path("mask.png"))


def test_mask_whose_name_holds_an_equals_sign_is_found(tmp_path: Path) -> None:
    mask = tmp_path / "a=b.png"
    mask.write_bytes(b"")
    assert parse_prompt(mask=f"p=q.jpg={mask}") == MaskPrompt("p=q.jpg", mask)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "exactly one"),
        ({"click": "b=1,2", "mask": "b=a.png"}, "exactly one"),
        ({"click": "IMG.jpg"}, "PHOTO=x,y"),
        ({"click": "IMG.jpg=1"}, "PHOTO=x,y"),
        ({"click": "IMG.jpg=nan,2"}, "PHOTO=x,y"),
        ({"click": "=1,2"}, "PHOTO=x,y"),
        ({"box": "IMG.jpg=1,2,3"}, "PHOTO=x0,y0,x1,y1"),
        ({"box": "IMG.jpg=1,2,1,9"}, "smaller than a pixel"),
        ({"mask": "mask.png"}, "PHOTO=MASK.png"),
    ],
)
def test_other_forms_are_refused_with_the_right_one(given: dict[str, str], message: str) -> None:
    with pytest.raises(PromptError, match=message):
        parse_prompt(**given)


def test_text_without_words_is_refused() -> None:
    with pytest.raises(PromptError, match="prompt is empty"):
        TextPrompt("  ")


def test_unknown_photo_names_the_nearest(blobs: BlobScene) -> None:
    with pytest.raises(PromptError, match=r"Did you mean .*view_3\.png"):
        camera_of_prompt(ClickPrompt("View_3.PNG", 1, 1), blobs.cameras)
    with pytest.raises(PromptError, match=r"Photos are called: view_0\.png"):
        camera_of_prompt(ClickPrompt("zzz", 1, 1), blobs.cameras)


def test_photo_that_was_not_placed_is_said_so(blobs: BlobScene) -> None:
    from dataclasses import replace

    cameras = replace(blobs.cameras, unregistered=("lost.png",))
    with pytest.raises(PromptError, match=r"lost\.png could not be placed"):
        camera_of_prompt(ClickPrompt("lost.png", 1, 1), cameras)


def test_places_outside_of_the_photo_are_refused_with_its_size(blobs: BlobScene) -> None:
    for prompt in (ClickPrompt("view_0.png", 160, 10), ClickPrompt("view_0.png", 3, -1)):
        with pytest.raises(PromptError, match="160 x 120 pixels"):
            camera_of_prompt(prompt, blobs.cameras)
    with pytest.raises(PromptError, match="outside of the photo"):
        camera_of_prompt(BoxPrompt("view_0.png", 200, 0, 300, 50), blobs.cameras)
    assert camera_of_prompt(BoxPrompt("view_0.png", -5, -5, 300, 50), blobs.cameras).photo == "view_0.png"


def test_mask_pictures_of_any_kind_are_read(blobs: BlobScene, tmp_path: Path) -> None:
    camera = blobs.cameras.cameras[0]
    truth = blobs.labels[camera.photo] == 1
    grey = Image.fromarray((truth * 255).astype(np.uint8))
    wide = Image.fromarray((truth * 65535).astype(np.uint16))
    for kind, picture in {
        "L": grey,
        "RGB": grey.convert("RGB"),
        "RGBA": grey.convert("RGBA"),
        "1": grey.convert("1"),
        "16": wide,
    }.items():
        picture.save(tmp_path / f"{kind}.png")
        np.testing.assert_array_equal(load_mask(tmp_path / f"{kind}.png", camera), truth, err_msg=kind)


def test_unusable_masks_say_why(blobs: BlobScene, tmp_path: Path) -> None:
    camera = blobs.cameras.cameras[0]
    Image.new("L", (160, 120)).save(tmp_path / "black.png")
    Image.new("L", (80, 60), 255).save(tmp_path / "small.png")
    (tmp_path / "text.png").write_text("no picture")
    with pytest.raises(MaskError, match="is empty"):
        load_mask(tmp_path / "black.png", camera)
    with pytest.raises(MaskError, match=r"80 x 60 pixels, but view_0\.png is 160 x 120"):
        load_mask(tmp_path / "small.png", camera)
    for name in ("text.png", "missing.png"):
        with pytest.raises(MaskError, match="cannot be read"):
            load_mask(tmp_path / name, camera)


def test_mask_that_states_a_huge_size_is_refused_before_it_is_decoded(
    blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = replace(blobs.cameras.cameras[0], width=30_000, height=30_000)
    Image.new("1", (30_000, 30_000)).save(tmp_path / "bomb.png")

    def decoded(*_: object) -> None:
        raise AssertionError("decoded")

    monkeypatch.setattr(ImageFile.ImageFile, "load", decoded)
    with pytest.raises(MaskError, match="30000 x 30000 pixels, but"):
        load_mask(tmp_path / "bomb.png", blobs.cameras.cameras[0])
    with pytest.raises(MaskError, match="more than can be read safely"):
        load_mask(tmp_path / "bomb.png", camera)


@pytest.mark.parametrize("name", ["cut.png", "cut.tif", "damaged.png", "drawing.eps"])
def test_damaged_mask_is_a_sentence(name: str, blobs: BlobScene, tmp_path: Path) -> None:
    camera = blobs.cameras.cameras[0]
    file = tmp_path / name
    Image.new("RGB", (camera.width, camera.height), "white").save(file)
    content = bytearray(file.read_bytes())
    if name.startswith("cut"):
        del content[len(content) // 2 :]
    elif name.startswith("damaged"):
        content[40:60] = b"\xff" * 20
    file.write_bytes(content)
    with pytest.raises(MaskError, match=rf"{name} cannot be read: .* Save it as PNG"):
        load_mask(file, camera)


def test_prompt_is_stored_without_folders_of_this_machine() -> None:
    assert describe_prompt(MaskPrompt("a.jpg", Path("some") / "where" / "m.png"))["mask"] == "m.png"
    assert describe_prompt(ClickPrompt("a.jpg", 1, 2)) == {"kind": "click", "photo": "a.jpg", "x": 1, "y": 2}
