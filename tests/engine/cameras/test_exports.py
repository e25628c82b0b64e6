"""Cameras that Metashape, RealityCapture and RealityScan export are those of the photos, or are refused with a
reason."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.cameras.brown_lens import BrownLens
from engine.cameras.given import has_points, read_cameras
from engine.cameras.settings import CameraSettings
from engine.cameras.undistortion import project
from engine.core.arrays import Float64
from engine.core.errors import CameraError, FormatError, HeritageError
from engine.core.events import Warned
from engine.scene import CameraSet, lens_pixels

from .conftest import HEIGHT, LENS, WIDTH, Scene
from .test_given import POINTS, assert_true

pytestmark = pytest.mark.usefixtures("readers_in_this_process")

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)
FOCAL, CX, CY, K1 = LENS
ORIGIN = np.zeros(3)


@pytest.fixture(autouse=True)
def _points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some points instead of matched features: only the cameras matter here."""
    points = np.array([[1.4, 1.4, 0.5], [1.0, 2.0, 0.5], [2.0, 1.0, 0.0]]), np.zeros((3, 3), np.uint8), math.nan
    monkeypatch.setattr("engine.cameras.given.triangulate", lambda *_, **__: points)


def numbers(values: Any) -> str:
    return " ".join(f"{value:.16g}" for value in np.asarray(values, np.float64).ravel())


# ---- Metashape

CALIBRATION = f"<f>{FOCAL}</f><cx>{CX - WIDTH / 2}</cx><cy>{CY - HEIGHT / 2}</cy><k1>{K1}</k1>"
WORLD = (
    "<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 20 30</translation><scale>2</scale></transform>"
)


def metashape(
    scene: Scene,
    *,
    calibration: str = CALIBRATION,
    kind: str = "frame",
    component: str = "",
    camera: Callable[[int], str] = lambda index: "",
    chunk: str = 'label="Chunk 1" enabled="true"',
    name: Callable[[str], str] = lambda photo: photo,
) -> str:
    """Return the chunk of an export."""
    cameras = "".join(
        f'<camera id="{index}" sensor_id="0" component_id="0" label="{name(one.photo)}" {camera(index)}>'
        f"<transform>{numbers(np.linalg.inv(one.viewmat))}</transform><orientation>1</orientation></camera>"
        for index, one in enumerate(scene.cameras)
    )
    return (
        f'<chunk {chunk}><sensors next_id="1"><sensor id="0" label="Acme" type="{kind}">'
        f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
        f'<calibration type="{kind}" class="initial"><f>999</f></calibration>'
        f'<calibration type="{kind}" class="adjusted">{calibration}</calibration>'
        f'</sensor></sensors><components><component id="0" label="Component 1">{component}</component></components>'
        f'<cameras next_id="9"><group id="0">{cameras}</group>'
        '<camera id="99" sensor_id="0" label="not aligned"/></cameras></chunk>'
    )


def document(*chunks: str) -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0">{"".join(chunks)}</document>\n'


def written(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("chosen", ["file", "folder"])
def test_metashape_cameras_are_read(room: Scene, tmp_path: Path, chosen: str) -> None:
    file = written(tmp_path / "export", "cameras.xml", document(metashape(room)))
    assert not has_points(file)
    assert_true(read_cameras(file if chosen == "file" else file.parent, room.photo_set), room, ORIGIN)


def test_metashape_names_without_suffix_are_those_of_the_photos(room: Scene, tmp_path: Path) -> None:
    text = document(metashape(room, name=lambda photo: Path(photo).stem))
    assert len(read_cameras(written(tmp_path, "cameras.xml", text), room.photo_set).cameras) == 8


def test_the_world_of_a_metashape_component_is_the_original_frame(room: Scene, tmp_path: Path) -> None:
    file = written(tmp_path, "cameras.xml", document(metashape(room, component=WORLD)))
    found = read_cameras(file, room.photo_set)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for camera, true in zip(found.cameras, room.cameras, strict=True):
        back = found.original_from_world[:3, :3] @ camera.center + found.original_from_world[:3, 3]
        assert np.abs(back - (2 * turn @ true.center + (10, 20, 30))).max() < 1e-6
    assert_shows_the_same(found, room, lambda points: 2 * points @ turn.T + (10, 20, 30))


def assert_shows_the_same(
    found: CameraSet, room: Scene, original: Callable[[Float64], Float64] = lambda points: points
) -> None:
    world = (original(POINTS) - found.original_from_world[:3, 3]) @ np.linalg.inv(found.original_from_world[:3, :3]).T
    truth = {camera.photo: camera for camera in room.cameras}
    for camera in found.cameras:
        assert np.abs(project(camera, world)[0] - project(truth[camera.photo], POINTS)[0]).max() < 0.01


def test_disabled_metashape_cameras_and_chunks_are_left_out(room: Scene, tmp_path: Path) -> None:
    text = metashape(room, camera=lambda index: 'enabled="false"' if index < 2 else "")
    off = metashape(room, chunk='label="old" enabled="false"')
    found = read_cameras(written(tmp_path, "cameras.xml", document(off, text)), room.photo_set)
    assert found.unregistered == ("00.png", "01.png")


def test_metashape_chunks_that_share_no_photos_are_told(room: Scene, tmp_path: Path) -> None:
    first = metashape(Scene(room.photo_set, room.cameras[:3]), chunk='label="front"')
    second = metashape(Scene(room.photo_set, room.cameras[3:]), chunk='label="back"')
    events: list[object] = []
    file = written(tmp_path, "cameras.xml", document(first, second))
    assert len(read_cameras(file, room.photo_set, emit=events.append).cameras) == 5
    (warning,) = (event for event in events if isinstance(event, Warned))
    assert "the largest, chunk back with 5 photos, is used" in warning.message
    assert "chunk front with 3 more photos" in warning.message


BROWN = BrownLens(
    WIDTH, HEIGHT, 381.0, 380.0, 203.0, 149.0, radial=(-0.1, 0.05, -0.02, 0.01), tangential=(0.002, -0.003), skew=0.01
)


def brown_pixels(lens: BrownLens, directions: Float64) -> Float64:
    """The formula of the Metashape manual."""
    x, y = directions.T
    if lens.fisheye:
        radius = np.hypot(x, y)
        x, y = x * np.arctan(radius) / radius, y * np.arctan(radius) / radius
    r2 = x * x + y * y
    radial = 1 + sum(k * r2 ** (power + 1) for power, k in enumerate(lens.radial))
    p1, p2 = lens.tangential
    u = x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    v = y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    return np.stack([lens.cx + lens.fx * u + lens.skew * v, lens.cy + lens.fy * v], axis=1)


@pytest.mark.parametrize("fisheye", [False, True])
def test_all_coefficients_of_a_metashape_lens_act_as_in_its_manual(room: Scene, tmp_path: Path, fisheye: bool) -> None:
    values = {"f": 380.0, "cx": 3.0, "cy": -1.0, "b1": 1.0, "b2": 0.01}
    values |= dict(zip(("k1", "k2", "k3", "k4"), BROWN.radial, strict=True)) | {"p1": 0.002, "p2": -0.003}
    calibration = "".join(f"<{name}>{value}</{name}>" for name, value in values.items())
    text = document(metashape(room, calibration=calibration, kind="fisheye" if fisheye else "frame"))
    camera = read_cameras(written(tmp_path, "cameras.xml", text), room.photo_set).cameras[0]
    directions = np.random.default_rng(0).uniform((-0.5, -0.38), (0.5, 0.38), (200, 2))
    expected = brown_pixels(BrownLens(**{**vars(BROWN), "fisheye": fisheye}), directions)
    # The tolerance of `brown_lens` for 400 pixels: 0.1.
    assert np.abs(lens_pixels(camera.lens, directions) - expected).max() < 0.1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (document("<chunk label='a'><sensors/>"), "it is not whole XML"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + document("<chunk><sensors/></chunk>"), "it has a document type"),
        (document("<chunk>" + "<a>" * 100 + "</a>" * 100 + "</chunk>"), "nested too deeply"),
        (document("<chunk label='a'><sensors/><cameras/></chunk>"), "has no placed pictures"),
        ("METASHAPE b1", "type spherical, which is not supported.*Export the cameras as a COLMAP model"),
        ("METASHAPE b2", "skewed, which is not supported.*as a COLMAP model"),
        ("METASHAPE transform", "16 should"),
        ("METASHAPE rotation", "is not a rotation and a translation"),
        ("METASHAPE twice", "has two cameras called same"),
    ],
)
def test_metashape_exports_that_cannot_be_used_are_refused(
    room: Scene, tmp_path: Path, text: str, sentence: str
) -> None:
    good = document(metashape(room))
    text = {
        "METASHAPE b1": document(metashape(room, kind="spherical")),
        "METASHAPE b2": document(metashape(room, calibration=CALIBRATION + "<b2>50</b2>")),
        "METASHAPE transform": good.replace("<transform>", "<transform>1 "),
        "METASHAPE rotation": good.replace("<transform>", "<transform>7"),
        "METASHAPE twice": document(metashape(room, name=lambda photo: "same")),
    }.get(text, text)
    with pytest.raises(CameraError, match=sentence) as caught:
        read_cameras(written(tmp_path, "cameras.xml", text), room.photo_set)
    assert "cameras.xml" in str(caught.value)


# ---- RealityCapture and RealityScan


def angles(viewmat: Float64) -> tuple[float, float, float]:
    """Return heading, pitch and roll in degrees for the rotation Rz(-heading) Rx(pitch) Ry(roll) of OpenGL axes."""
    r = viewmat[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
    pitch = math.asin(r[2, 1])
    heading, roll = -math.atan2(-r[0, 1], r[1, 1]), math.atan2(-r[2, 0], r[2, 2])
    return math.degrees(heading), math.degrees(pitch), math.degrees(roll)


OLD_HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
NEW_HEADER = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2"


def reality_csv(scene: Scene, header: str = OLD_HEADER, lens: str = f"{K1},1e-9,0,0,0,0") -> str:
    lines = [f"#cameras {len(scene.cameras)}", header]
    for camera in scene.cameras:
        f, px, py = FOCAL / WIDTH * 36, (CX - WIDTH / 2) / WIDTH, (CY - HEIGHT / 2) / WIDTH
        pose = ",".join(f"{value:.15g}" for value in (*camera.center, *angles(camera.viewmat), f, px, py))
        lines.append(f"{camera.photo},{pose},{lens}")
    return "\n".join(lines) + "\n"


def test_camera_that_looks_at_the_horizon_in_the_north_has_heading_0_and_pitch_90(room: Scene, tmp_path: Path) -> None:
    """RealityCapture's own convention: heading is clockwise from north (y), a pitch of 0 looks straight down."""
    text = f"{OLD_HEADER}\n00.png,1,2,3,0,90,0,36,0,0,0,0,0,0,0,0\n01.png,1,2,3,90,90,0,36,0,0,0,0,0,0,0,0\n"
    found = read_cameras(written(tmp_path, "cameras.csv", text), room.photo_set)
    size = np.cbrt(np.linalg.det(found.original_from_world[:3, :3]))
    original = [camera.viewmat[:3, :3] @ found.original_from_world[:3, :3].T / size for camera in found.cameras]
    assert np.allclose(original[0], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-9)
    assert np.allclose(original[1], [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-9)


@pytest.mark.parametrize("header", [OLD_HEADER, NEW_HEADER], ids=["old", "new"])
def test_reality_capture_csv_is_read(room: Scene, tmp_path: Path, header: str) -> None:
    file = written(tmp_path, "registration.csv", reality_csv(room, header))
    found = read_cameras(file, room.photo_set)
    assert len(found.cameras) == 8
    assert_shows_the_same(found, room)


def xmp(camera: Any, *, attributes: str = "", model: str = "brown3", coefficients: str = f"{K1} 0 0 0 0 0") -> str:
    f, px, py = FOCAL / WIDTH * 36, (CX - WIDTH / 2) / WIDTH, (CY - HEIGHT / 2) / WIDTH
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xcr:Version="3" xcr:PosePrior="initial" xcr:Coordinates="absolute" {attributes} '
        f'xcr:DistortionModel="{model}" xcr:FocalLength35mm="{f:.15g}" xcr:Skew="0" xcr:AspectRatio="1" '
        f'xcr:PrincipalPointU="{px:.15g}" xcr:PrincipalPointV="{py:.15g}" '
        'xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">'
        f"<xcr:Rotation>{numbers(camera.viewmat[:3, :3])}</xcr:Rotation>"
        f"<xcr:Position>{numbers(camera.center)}</xcr:Position>"
        f"<xcr:DistortionCoeficients>{coefficients}</xcr:DistortionCoeficients>"
        "</rdf:Description></rdf:RDF></x:xmpmeta>"
    )


def test_reality_capture_xmp_files_beside_the_photos_are_read(room: Scene, tmp_path: Path) -> None:
    for camera in room.cameras[:7]:
        written(tmp_path, f"{Path(camera.photo).stem}.xmp", xmp(camera))
    # What other programs store beside photos is no camera.
    written(tmp_path, "07.xmp", '<x:xmpmeta xmlns:x="adobe:ns:meta/"/>')
    found = read_cameras(tmp_path, room.photo_set)
    assert found.unregistered == ("07.png",)
    assert_shows_the_same(found, room)


def test_reality_capture_components_are_parts(room: Scene, tmp_path: Path) -> None:
    for index, camera in enumerate(room.cameras):
        component = f'xcr:ComponentId="{{{"A" if index < 3 else "B"}}}"'
        written(tmp_path, f"{Path(camera.photo).stem}.xmp", xmp(camera, attributes=component))
    events: list[object] = []
    assert len(read_cameras(tmp_path, room.photo_set, emit=events.append).cameras) == 5
    assert any(isinstance(event, Warned) and "has 2 parts" in event.message for event in events)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.csv", OLD_HEADER.replace(",heading", "") + "\n", "it has no column heading.*Internal/External Camera"),
        ("a.csv", f"{OLD_HEADER}\n00.png,1,2,3,0,90,0,36,0,0,0,0\n", "the row of 00.png is too short"),
        ("a.csv", f"{OLD_HEADER}\n00.png,a,2,3,0,90,0,36,0,0,0,0,0,0,0,0\n", "is no number"),
        ("a.csv", f"{OLD_HEADER}\n00.png,nan,2,3,0,90,0,36,0,0,0,0,0,0,0,0\n", "is not finite"),
        ("a.csv", f"{OLD_HEADER}\n00.png,1,2,3,0,90,0,36,0,0,-0.2,0,0,0,0,0\n", "division model.*Brown3"),
        ("a.csv", f"{OLD_HEADER}\n00.png,1,2,3,0,90,0,0,0,0,0,0,0,0,0,0\n", "focal length must be above 0"),
        ("a.out", "# Bundle file v0.3\n8 100\n", "no text file beside it lists the names of its 8 pictures"),
        ("a.xml", "<html></html>", "holds no cameras of a known kind"),
        ("a.txt", "hello", "holds no cameras of a known kind"),
    ],
)
def test_exports_that_cannot_be_used_are_refused(
    room: Scene, tmp_path: Path, name: str, text: str, sentence: str
) -> None:
    with pytest.raises(CameraError, match=sentence):
        read_cameras(written(tmp_path, name, text), room.photo_set)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"model": "division", "coefficients": "-0.2 0 0 0 0 0"}, "model is division, which is not supported"),
        ({"model": "rationalP2D1", "coefficients": "-0.2 1 0 0 0 0"}, "is rationalp2d1, which is not supported"),
        ({"coefficients": "1 2"}, "2 numbers stand where 6 should"),
    ],
)
def test_xmp_files_that_cannot_be_used_are_refused(
    room: Scene, tmp_path: Path, change: dict[str, str], sentence: str
) -> None:
    written(tmp_path, "00.xmp", xmp(room.cameras[0], **change))
    with pytest.raises(CameraError, match=rf"00\.xmp cannot be used: .*{sentence}.*Brown3"):
        read_cameras(tmp_path, room.photo_set)


def bundler(room: Scene, count: int = 8) -> str:
    """Return a Bundler file whose points are those of the other tests, all seen by all cameras."""
    lines = ["# Bundle file v0.3", f"{count} {len(POINTS)}"]
    for camera in room.cameras[:count]:
        pose = np.diag([1.0, -1.0, -1.0]) @ camera.viewmat[:3]
        lines += [f"{FOCAL} {K1} 0", *(numbers(row) for row in pose[:, :3]), numbers(pose[:, 3])]
    for point in POINTS:
        lines += [numbers(point), "10 20 30", f"{count} " + " ".join(f"{one} 0 0.0 0.0" for one in range(count))]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("ending", ["", " 0 380.5"], ids=["names", "with-focal-lengths"])
def test_bundler_cameras_and_points_are_read(room: Scene, tmp_path: Path, ending: str) -> None:
    written(tmp_path, "bundle.out", bundler(room))
    written(tmp_path, "list.txt", "".join(f"./scans/{camera.photo}{ending}\n" for camera in room.cameras))
    found = read_cameras(tmp_path, room.photo_set)
    assert has_points(tmp_path)
    assert len(found.points) == len(POINTS) and found.point_colors[0].tolist() == [10, 20, 30]
    assert_true(found, room, ORIGIN)


def test_a_bundler_file_that_is_cut_is_refused(room: Scene, tmp_path: Path) -> None:
    file = written(tmp_path, "bundle.out", bundler(room)[:-100])
    written(tmp_path, "list.txt", "".join(f"{camera.photo}\n" for camera in room.cameras))
    with pytest.raises(CameraError, match=r"bundle\.out cannot be used: it ends too early\. Export it again"):
        read_cameras(file, room.photo_set)


def test_a_division_model_without_distortion_is_a_plain_lens(room: Scene, tmp_path: Path) -> None:
    written(tmp_path, "00.xmp", xmp(room.cameras[0], model="division", coefficients="0 0 0 0 0 0"))
    assert read_cameras(tmp_path, room.photo_set).cameras[0].model == "PINHOLE"


def test_one_of_several_exports_in_a_folder_must_be_chosen(room: Scene, tmp_path: Path) -> None:
    written(tmp_path, "a.csv", reality_csv(room))
    written(tmp_path, "b.csv", reality_csv(room))
    with pytest.raises(CameraError, match=r"several files with cameras: a\.csv and b\.csv\. Choose one"):
        read_cameras(tmp_path, room.photo_set)
    (tmp_path / "b.csv").unlink()
    written(tmp_path, "c.xml", document(metashape(room)))
    with pytest.raises(CameraError, match="has cameras of two programs"):
        read_cameras(tmp_path, room.photo_set)


def test_a_huge_xml_file_is_refused_without_reading_it(room: Scene, tmp_path: Path) -> None:
    file = written(tmp_path, "cameras.xml", document(metashape(room)))
    with file.open("r+b") as stream:
        stream.truncate(200 << 20)
    with pytest.raises(FormatError, match="it is larger than 134 MB"):
        read_cameras(file, room.photo_set)
    assert issubclass(FormatError, HeritageError)
