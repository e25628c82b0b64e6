"""A damaged or hostile file is refused in one sentence: nothing is printed, and nothing outside the project changes."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part

pytestmark = pytest.mark.once

Damage = Callable[[Path], object]

PROPERTIES = [
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
]


def ply(
    n: str = "2", rows: int = 2, value: float = 0.5, properties: list[str] | None = None, head: str = "", kind: str = ""
) -> bytes:
    """Return a PLY file whose header states `n` Gaussians and which has `rows`."""
    names = PROPERTIES if properties is None else properties
    lines = ["ply", f"format {kind or 'binary_little_endian'} 1.0", *([head] if head else []), f"element vertex {n}"]
    lines += [f"property float {name}" for name in names]
    return "\n".join([*lines, "end_header", ""]).encode() + np.full((rows, len(names)), value, "<f4").tobytes()


PLY_FILES: dict[str, bytes] = {
    "empty": b"",
    "magic only": b"ply\n",
    "not a PLY": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "text": b"hello " * 1000,
    "header does not end": b"ply\nformat binary_little_endian 1.0\nelement vertex 2\n" + b"comment x\n" * 200_000,
    "no format": ply().replace(b"format binary_little_endian 1.0\n", b""),
    "ASCII": ply(kind="ascii"),
    "compressed": ply(head="element chunk 1\nproperty float min_x"),
    "no Gaussians": ply("0", 0),
    "negative count": ply("-1"),
    "count of a trillion": ply("1000000000000"),
    "count of 400 digits": ply("9" * 400),
    "count that is no number": ply("two"),
    "cut": ply()[:-5],
    "cut in the header": ply()[:60],
    "NaN": ply(value=float("nan")),
    "infinite": ply(value=float("inf")),
    "point cloud": ply(properties=["x", "y", "z"]),
    "no properties": ply(properties=[]),
    "property twice": ply(properties=[*PROPERTIES, "x"]),
    "odd number of f_rest": ply(properties=[*PROPERTIES, "f_rest_0"]),
    "unknown type": ply().replace(b"property float x", b"property quaternion x"),
    "list of vertices": ply().replace(b"property float x", b"property list uchar int x"),
    "property before element": ply(head="property float a"),
    "null bytes": bytes(1000),
}


def write(name: str, content: bytes | str) -> Damage:
    """Return a function that replaces a file of a project."""

    def damage(project: Path) -> None:
        file = project / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content.encode() if isinstance(content, str) else content)

    return damage


def cut(name: str) -> Damage:
    """Return a function that cuts a file of a project in half."""

    def damage(project: Path) -> None:
        data = (project / name).read_bytes()
        (project / name).write_bytes(data[: len(data) // 2])

    return damage


def array(name: str, values: Any) -> Damage:
    """Return a function that replaces an array of a project."""
    stream = io.BytesIO()
    np.save(stream, values)
    return write(name, stream.getvalue())


def changed(file: str, /, **values: Any) -> Damage:
    """Return a function that changes values of a JSON file of a project."""

    def damage(project: Path) -> None:
        data = json.loads((project / file).read_text(encoding="utf-8"))
        (project / file).write_text(json.dumps({**data, **values}))

    return damage


def camera(**values: Any) -> Damage:
    """Return a function that changes values of the camera."""

    def damage(project: Path) -> None:
        file = project / "cameras" / "cameras.json"
        data = json.loads(file.read_text(encoding="utf-8"))
        data["cameras"][0].update(values)
        file.write_text(json.dumps(data))

    return damage


def link(name: str, target: str) -> Damage:
    """Return a function that replaces a file or folder of a project by a link to `target`, beside the project."""

    def damage(project: Path) -> None:
        path = project / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        path.symlink_to(project.parent / target)

    return damage


def pipe(name: str) -> Damage:
    """Return a function that replaces a file of a project by a pipe, which nobody writes to."""

    def damage(project: Path) -> None:
        (project / name).unlink()
        os.mkfifo(project / name)

    return damage


def header_of(shape: str) -> bytes:
    """Return a NumPy file that states `shape` and has no values."""
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + (len(text) + 1).to_bytes(2, "little") + text + b"\n"


SCENE, CAMERAS, POINTS = "gaussians/scene.ply", "cameras/cameras.json", "cameras/points.npz"
OBJECT, MEMBERSHIP, RECORD = "objects/vase/object.json", "objects/vase/membership.npy", "objects/vase/record.json"
DETAIL = "objects/vase/detail.npz"
PROJECTS: dict[str, Damage] = {
    "no scene": lambda project: (project / SCENE).unlink(),
    "scene cut": cut(SCENE),
    "scene is a folder": lambda project: ((project / SCENE).unlink(), (project / SCENE).mkdir()),
    "scene is a link out": link(SCENE, "elsewhere.ply"),
    "scene is a link to itself": link(SCENE, "müseum room_heritage/" + SCENE),
    "cameras empty": write(CAMERAS, ""),
    "cameras cut": cut(CAMERAS),
    "cameras not UTF-8": write(CAMERAS, b"\xff\xfe{}"),
    "cameras nested": write(CAMERAS, "[" * 100_000),
    "cameras are a link out": link("cameras", "elsewhere"),
    "cameras are a pipe": pipe(CAMERAS),
    "points cut": cut(POINTS),
    "points missing": lambda project: (project / POINTS).unlink(),
    "camera without pixels": camera(width=0),
    "camera of 10^30 pixels": camera(width=10**30),
    "camera without focal length": camera(params=[0, 0, 0, 0]),
    "camera with an unknown lens": camera(model="PERISCOPE"),
    "camera without pose": camera(viewmat=[]),
    "camera with a flat pose": camera(viewmat=[[0] * 4] * 4),
    "camera of a photo elsewhere": camera(photo="../../x.jpg"),
    "object empty": write(OBJECT, ""),
    "object nested": write(OBJECT, "[" * 100_000),
    "object is a list": write(OBJECT, "[]"),
    "object without a name": write(OBJECT, '{"version": 1, "threshold": 0.5}'),
    "object with a number as name": changed(OBJECT, name=5),
    "object with an infinite threshold": write(OBJECT, '{"version": 1, "name": "x", "threshold": 1e999}'),
    "object with a threshold of 5,000 digits": write(OBJECT, f'{{"version":1,"name":"x","threshold":1{"0" * 5000}}}'),
    "object at a missing level": changed(OBJECT, level=7),
    "object at level -1": changed(OBJECT, level=-1),
    "object with a text as levels": changed(OBJECT, levels="many"),
    "object with half a surrogate pair": write(OBJECT, '{"version": 1, "name": "\\ud800", "threshold": 0.5}'),
    "object of a later version": changed(OBJECT, version=99),
    "object of version 0": changed(OBJECT, version=0),
    "object is a link out": link(OBJECT, "elsewhere.json"),
    "folder of the object is a link out": lambda project: (
        shutil.copytree(project / "objects" / "vase", project.parent / "theirs"),
        link("objects/vase", "theirs")(project),
    ),
    "object that was damaged": changed(OBJECT, version=2, files={"membership.npy": {"size": 1, "sha256": "0" * 64}}),
    "object with files elsewhere": changed(OBJECT, version=2, files={"../../x": {"size": 1, "sha256": "0" * 64}}),
    "levels missing": changed(OBJECT, levels=[{"n_gaussians": 1}] * 2),
    "membership missing": lambda project: (project / MEMBERSHIP).unlink(),
    "membership empty": write(MEMBERSHIP, b""),
    "membership cut": cut(MEMBERSHIP),
    "membership of another scene": array(MEMBERSHIP, np.zeros(99, np.float32)),
    "membership of two axes": array(MEMBERSHIP, np.zeros((100, 1), np.float32)),
    "membership of integers": array(MEMBERSHIP, np.zeros(100, np.int64)),
    "membership with NaN": array(MEMBERSHIP, np.full(100, np.nan, np.float32)),
    "membership of 10^12 values": write(MEMBERSHIP, header_of("(1000000000000,)")),
    "membership of -1 values": write(MEMBERSHIP, header_of("(-1,)")),
    "membership with a damaged header": write(MEMBERSHIP, header_of("(((((")),
    "membership is an archive": write(MEMBERSHIP, b"PK\x03\x04" + bytes(100)),
    "membership is a link out": link(MEMBERSHIP, "elsewhere.npy"),
    "membership is a pipe": pipe(MEMBERSHIP),
    "record damaged": write(RECORD, '{"version": 1, "title": ['),
    "record with a list as title": write(RECORD, '{"version": 1, "title": []}'),
    "detail cut": write(DETAIL, b"PK\x03\x04"),
    "detail is no archive": write(DETAIL, header_of("(1,)")),
}


def tree(folder: Path) -> dict[str, str]:
    """Return the hash of each file below `folder`, links not followed."""
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() and not path.is_symlink() else ""
        for path in folder.rglob("*")
    }


@pytest.fixture
def log(part: Part, tmp_path: Path) -> Path:
    """Return the log of unexpected errors, which a test expects not to be written."""
    file: Path = part("gaussian_heritage_addon.setup.preferences").user_folder("log") / "errors.log"
    file.unlink(missing_ok=True)
    part("gaussian_heritage_addon.blender.problems")._logged.clear()
    return file


def sentence_of(call: Callable[[], object]) -> str:
    """Return what an operator that must fail reports."""
    with pytest.raises(RuntimeError) as caught:
        call()
    return str(caught.value).strip().removeprefix("Error: ")


def is_sentence(text: str, log: Path) -> bool:
    return 20 < len(text) < 1000 and text.endswith(".") and "\n" not in text and not log.exists()


@pytest.mark.parametrize("content", PLY_FILES.values(), ids=PLY_FILES.keys())
def test_ply_file_that_cannot_be_imported_is_refused_in_a_sentence(
    blender: ModuleType, log: Path, content: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "hostile.ply"
    file.write_bytes(content)
    text = sentence_of(lambda: bpy.ops.heritage.import_gaussian_ply(filepath=str(file)))
    assert is_sentence(text, log) and str(file) in text, text
    assert "Traceback" not in "".join(capfd.readouterr())
    assert len(bpy.data.objects) == 0


@pytest.mark.parametrize("name", ["missing.ply", "", ".", "a\n.ply", "x" * 300])
def test_path_that_is_no_file_is_refused_in_a_sentence(
    blender: ModuleType, log: Path, name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = sentence_of(lambda: bpy.ops.heritage.import_gaussian_ply(filepath=str(tmp_path / name)))
    assert is_sentence(text, log), text
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("damage", PROJECTS.values(), ids=PROJECTS.keys())
def test_project_that_cannot_be_opened_is_refused_in_a_sentence(
    project: Any, log: Path, damage: Damage, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, content in (("elsewhere.ply", ply()), ("elsewhere.json", b"{}"), ("elsewhere.npy", header_of("(0,)"))):
        (tmp_path / name).write_bytes(content)
    (tmp_path / "elsewhere").mkdir()
    damage(project.folder)
    before = tree(tmp_path)
    text = sentence_of(lambda: bpy.ops.heritage.open_project(directory=str(project.folder)))
    assert is_sentence(text, log), text
    assert "Traceback" not in "".join(capfd.readouterr())
    assert tree(tmp_path) == before


def test_project_with_a_hostile_list_of_candidates_can_be_used(
    project: Any, part: Part, log: Path, draw: Callable[[str], Any]
) -> None:
    bpy.ops.heritage.open_project(directory=str(project.folder))
    file = project.folder / "objects" / "candidates.json"
    entry = {"number": 1, "text": "a", "score": 0.1, "photo": "b", "picture": "objects/x.png"}
    for number, content in enumerate(
        ("", "[]", "{", '{"refused": 5}', [{**entry, "picture": "/etc/passwd"}], [{**entry, "number": "x"}], [entry])
    ):
        data = content if isinstance(content, str) else json.dumps({"refused": [], "candidates": content})
        file.write_text(data)
        os.utime(file, (number, number))
        drawn = draw("HERITAGE_PT_objects")
        assert "heritage.export_objects" in dict(drawn.buttons), "the rest of the panel is drawn"
        assert any("cannot be read" in text or "leads out" in text for text in [" ".join(drawn.texts)]) == (number < 6)
        assert not log.exists()


def test_picture_with_too_many_pixels_is_not_decoded(part: Part, project: Any, tmp_path: Path) -> None:
    """A PNG file of one megabyte may state 20,000 x 20,000 pixels, which take 1.6 GB."""
    file = tmp_path / "bomb.png"
    file.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (20_000).to_bytes(4, "big") * 2 + b"\x08\x02\0\0\0")
    pictures = part("gaussian_heritage_addon.project.pictures")
    assert pictures.picture_icon(file) == 0 and pictures.picture_icon(file) == 0
    assert not [key for key in pictures._previews or {} if key.startswith(str(file))]
    frame, errors = part("gaussian_heritage_addon.project.photo_frame"), part("engine.core.errors")
    with pytest.raises(errors.PhotoError, match="20000 x 20000 pixels"):
        frame.require_small(file, 200_000_000)
