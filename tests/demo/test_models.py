"""Exhibits that other people modelled: libraries of Sweet Home 3D, made in these tests, become kinds of exhibits."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

OBJ = """\
mtllib box.mtl
v 0 0 0
v 4 0 0
v 4 8 0
v 0 8 0
v 2 4 16
v 99 99 99
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wood
f 1/1 2/2 3/3 4/4
usemtl clear
f -6//1 -5//1 -2//1
usemtl unknown
f 1 4 5
"""
MTL = "newmtl wood\nKd 1 0 0\nmap_Kd Wood.PNG\nnewmtl clear\nKd 0 0.5 1\nd 0.4\n"


def write_library(
    file: Path, names: list[str], obj: str = OBJ, size: tuple[float, float, float] = (40, 20, 10.5)
) -> None:
    picture = io.BytesIO()
    Image.new("RGB", (2, 3), (10, 200, 30)).save(picture, "PNG")
    lines = ["# a library", "id=test"]
    for number, name in enumerate(names, 1):
        lines += [f"name#{number}={name}", f"model#{number}=/things/box.obj"]
        lines += [f"{side}#{number}={one}" for side, one in zip(("width", "depth", "height"), size, strict=True)]
    with zipfile.ZipFile(file, "w") as library:
        library.writestr("PluginFurnitureCatalog.properties", "\n".join(lines))
        library.writestr("things/box.obj", obj)
        library.writestr("things/box.mtl", MTL)
        library.writestr("things/wood.png", picture.getvalue())


def read(folder: Path) -> list[Any]:
    from random_rooms.models import read_models

    return read_models(folder)


def test_a_model_has_the_size_of_the_library_and_stands_upright(tmp_path: Path) -> None:
    from random_rooms.models import read_picture
    from random_rooms.stuffs import Glass, Plain

    write_library(tmp_path / "a.sh3f", ["Box"])
    (model,) = read(tmp_path)
    assert (model.name, model.size) == ("Box", (0.4, 0.2, 0.105))
    wood, clear, unknown = model.parts(2.0)
    # The fan of the face with four corners, without the vertex that no face uses.
    assert wood.shape.quads.tolist() == [[0, 1, 2, 2], [0, 2, 3, 3]] and wood.shape.uvs.shape == (2, 4, 2)
    vertices = np.concatenate([part.shape.vertices for part in (wood, clear, unknown)])
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.8, 0.4, 0.21])
    # y of the file is up; its z, the front, is -Y.
    np.testing.assert_allclose(unknown.shape.vertices[-1], [0.4, -0.4, 0.105])
    assert read_picture(wood.stuff).tolist() == [[[10, 200, 30]] * 2] * 3
    assert isinstance(clear.stuff, Glass) and clear.stuff.tint == "#0080ff"
    assert isinstance(unknown.stuff, Plain)


def test_a_folder_without_libraries_and_a_damaged_one_are_told_in_a_sentence(tmp_path: Path) -> None:
    from random_rooms.models import ModelError

    with pytest.raises(ModelError, match=r"holds no \*\.sh3f files"):
        read(tmp_path)
    (tmp_path / "a.sh3f").write_bytes(b"no archive")
    with pytest.raises(ModelError, match="is no furniture library"):
        read(tmp_path)


@pytest.mark.parametrize("line", ["v 1 2", "v a b c", "f 1 2 300\n", "f x y z"])
def test_a_damaged_model_is_told_in_a_sentence(tmp_path: Path, line: str) -> None:
    from random_rooms.models import ModelError

    write_library(tmp_path / "a.sh3f", ["Box"], OBJ + line)
    with pytest.raises(ModelError, match="box.obj of .* cannot be read"):
        read(tmp_path)[0].parts(1.0)


@pytest.fixture
def catalogue(tmp_path: Path) -> Any:
    from random_rooms.model_kinds import _KINDS, model_catalogue

    names = [name for words in _KINDS.values() for several in words.values() for name in several]
    write_library(tmp_path / "a.sh3f", names, size=(30, 30, 40))
    return model_catalogue(tmp_path)


def test_rooms_are_drawn_from_models(catalogue: Any) -> None:
    from random_rooms.plan import draw_room

    room = draw_room(3, catalogue=catalogue)
    shown = {one.prompt for one in room.exhibits}
    assert shown <= set(catalogue.kind_of) and 6 <= len(room.exhibits) <= 14
    assert room.fingerprint() == draw_room(3, catalogue=catalogue).fingerprint()
    for word in room.absent:
        assert word not in shown
        assert not any(word in catalogue.kind_of[name].like for name in shown)


def test_words_for_what_no_room_shows_are_no_kinds(catalogue: Any) -> None:
    assert catalogue.everyday and not set(catalogue.everyday) & set(catalogue.kind_of)
    for kind in catalogue.kinds:
        assert kind.name not in kind.like
        for other in kind.like:
            assert other not in catalogue.kind_of or kind.name in catalogue.kind_of[other].like


def test_libraries_that_lack_a_kind_are_refused(tmp_path: Path) -> None:
    from random_rooms.model_kinds import model_catalogue
    from random_rooms.models import ModelError

    write_library(tmp_path / "a.sh3f", ["Vase"])
    with pytest.raises(ModelError, match="hold no 'Teapot'"):
        model_catalogue(tmp_path)


def test_a_folder_with_other_exhibits_is_refused(tmp_path: Path) -> None:
    from random_rooms.outputs import OtherRoomError, accepted_attempt

    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "room.json").write_text('{"seed": 3, "attempt": 2, "exhibits": "models"}', encoding="utf-8")
    assert accepted_attempt(tmp_path, 3, "models") == 2
    with pytest.raises(OtherRoomError, match="exhibits of 'models', not of 'own'"):
        accepted_attempt(tmp_path, 3)
