"""Readers of photos' and cameras' files, of the trained scene, and of other programs' models."""

from __future__ import annotations

import importlib.util
import json
import math
import shutil
import zipfile
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..places import ROOT
from .reader import Reader, addon
from .readers_project import write_object

if TYPE_CHECKING:
    from engine.scene import Camera, Gaussians, PhotoSet

FORMATS = ROOT / "tests" / "fixtures" / "formats"
_N = 3


def _gaussians(sh: int = 4, features: int | None = None) -> Gaussians:
    from engine.scene import Gaussians

    rng = np.random.default_rng(0)
    return Gaussians(
        means=rng.normal(size=(_N, 3)).astype(np.float32),
        log_scales=np.full((_N, 3), -2.0, np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (_N, 1)),
        opacity_logits=np.zeros(_N, np.float32),
        sh=rng.normal(size=(_N, sh, 3)).astype(np.float32),
        features=None if features is None else np.ones((_N, features), np.float32),
    )


def _photo_set(folder: Path) -> PhotoSet:
    from engine.scene import Photo, PhotoSet, RejectedPhoto

    photos = (Photo("a.jpg", 40, 30, 35.0, "0" * 64), Photo("hall/b.jpg", 40, 30, None, "1" * 64))
    return PhotoSet(folder, photos, (RejectedPhoto("c.jpg", "It is black."),))


def _cameras() -> tuple[Camera, ...]:
    from engine.scene import Camera

    views = [np.eye(4), np.eye(4)]
    views[1][:3, 3] = (0.5, 0.0, 0.1)
    lens = ("OPENCV", (35.0, 35.0, 20.0, 15.0, -0.05, 0.01, 0.0, 0.0))
    return tuple(Camera(name, 40, 30, *lens, view) for name, view in zip(("a.jpg", "hall/b.jpg"), views, strict=True))


def _write_photo_set(folder: Path) -> None:
    from engine.scene import write_photo_set

    write_photo_set(folder / "photos.json", _photo_set(folder))


def _read_photo_set(folder: Path) -> object:
    from engine.scene import read_photo_set

    return read_photo_set(folder / "photos.json").mask_files is not None


def _write_looks(folder: Path) -> None:
    looks = [{"name": "a.jpg", "texture": 0.4}, {"name": "b.jpg", "texture": 0.5}]
    (folder / "looks.json").write_text(json.dumps(looks))


def _read_looks(folder: Path) -> object:
    from engine.photos import read_photo_statistics

    return read_photo_statistics(folder / "looks.json")


def _write_cameras(folder: Path) -> None:
    from engine.scene import CameraSet, write_camera_set

    points = np.zeros((5, 3), np.float32)
    colors = np.zeros((5, 3), np.uint8)
    write_camera_set(folder / "cameras", CameraSet(_cameras(), ("c.jpg",), points, colors, 0.5, np.eye(4), False))


def _read_cameras(folder: Path) -> object:
    from engine.scene import read_camera_set

    return read_camera_set(folder / "cameras")


def _write_hand_membership(folder: Path) -> None:
    np.save(folder / "membership.npy", np.linspace(0, 1, 3, dtype=np.float32))


def _read_hand_membership(folder: Path) -> object:
    from engine.cli.commands.stored_edits import read_membership

    return read_membership(folder / "membership.npy")


def _write_measurement(folder: Path) -> None:
    from engine.scene import MeasuredDistance, Measurement, save_measurement

    _write_cameras(folder)
    a, b, c = (0.0, 0.0, 0.0), (1.0, 0.0, 0.1), (0.0, 1.0, 0.0)
    save_measurement(
        folder, Measurement((MeasuredDistance(a, b, 0.5), MeasuredDistance(a, c, 0.6)), (a, b, c), (a, c), b)
    )


def _load_measurement(folder: Path) -> object:
    from engine.scene import load_measurement

    measurement = load_measurement(folder)
    return measurement.measured_from_world, measurement.residuals, measurement.ground_residual


def _show_cameras(folder: Path) -> object:
    from engine.project.content import photo_camera

    camera = photo_camera(folder, "hall/b.jpg")
    return addon("project.photo_frame").remove_distortion(np.zeros((15, 20, 4), np.float32), camera)


def _write_camera(folder: Path) -> None:
    camera = {"width": 40, "height": 30, "fx": 35.0, "fy": 35.0, "cx": 20.0, "cy": 15.0, "viewmat": np.eye(4).tolist()}
    (folder / "camera.json").write_text(json.dumps(camera))


def _read_camera(folder: Path) -> object:
    from engine.cameras import parse_camera_json, read_camera_json
    from engine.core.files import read_text

    # The same as text, as Blender gives it.
    parse_camera_json(read_text(folder / "camera.json", advice=""))
    return read_camera_json(folder / "camera.json")


def _write_transforms(folder: Path) -> None:
    frames: list[dict[str, Any]] = []
    for camera in _cameras():
        matrix = np.eye(4)
        matrix[:3, :3] = camera.viewmat[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
        matrix[:3, 3] = camera.center
        frames.append({"file_path": f"./images/{camera.photo}", "transform_matrix": matrix.tolist()})
    frames[1] |= {"fl_x": 34.0, "k1": 0.01, "w": 40, "h": 30}
    lens = {"camera_model": "OPENCV", "w": 40, "h": 30, "fl_x": 35.0, "fl_y": 35.0, "cx": 20.0, "cy": 15.0, "k1": -0.05}
    data = {**lens, "camera_angle_x": 1.0, "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(data))
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "".join(
        f"property {kind}\n" for kind in ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
    )
    (folder / "points.ply").write_text(header + "end_header\n0 0 1 9 9 9\n0 1 1 9 9 9\n")


def _write_metashape(folder: Path) -> None:
    cameras = "".join(
        f'<camera id="{number}" sensor_id="0" component_id="0" label="{camera.photo}"><transform>'
        f"{' '.join(map(str, np.linalg.inv(camera.viewmat).ravel()))}</transform></camera>"
        for number, camera in enumerate(_cameras())
    )
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="1"><sensors><sensor id="0">'
        '<resolution width="40" height="30"/><calibration class="adjusted"><f>35</f><cx>0.5</cx><k1>-0.05</k1>'
        "<k4>0.01</k4></calibration></sensor></sensors>"
        '<components><component id="0"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation>'
        "<translation>1 2 3</translation><scale>2</scale></transform></component></components>"
        f"<cameras>{cameras}</cameras></chunk></document>"
    )


def _write_reality_csv(folder: Path) -> None:
    rows = (
        f"{camera.photo},0.5,1,2,10,80,{number},31.5,0.01,0,-0.05,0.01,0,0,0,0"
        for number, camera in enumerate(_cameras())
    )
    header = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
    (folder / "cameras.csv").write_text("\n".join(("#cameras 2", header, *rows)) + "\n")


def _write_reality_xmp(folder: Path) -> None:
    (folder / "a.xmp").write_text(
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" xcr:DistortionModel="brown3" '
        'xcr:FocalLength35mm="31.5" xcr:Skew="0" xcr:AspectRatio="1" xcr:PrincipalPointU="0.01">'
        "<xcr:Rotation>1 0 0 0 1 0 0 0 1</xcr:Rotation><xcr:Position>0.5 1 2</xcr:Position>"
        "<xcr:DistortionCoeficients>-0.05 0.01 0 0 0 0</xcr:DistortionCoeficients>"
        "</rdf:Description></rdf:RDF></x:xmpmeta>"
    )


def _read_export(folder: Path) -> object:
    from engine.cameras import has_points
    from engine.cameras.exports import cameras_of, read_export
    from engine.cameras.model_places import find_export
    from engine.scene import match_names

    has_points(folder)
    photos = _photo_set(folder).photos
    (makers,) = read_export(find_export(folder), folder, lambda: False).parts
    return cameras_of(makers, match_names(makers, [photo.name for photo in photos]).found, photos) or None


def _read_metashape(folder: Path) -> object:
    """Read an export as the child process does."""
    from engine.cameras.metashape import metashape_in_child

    return metashape_in_child(str(folder / "cameras.xml"), str(folder / "arrays.npz"), "The export")


def _read_reality_csv(folder: Path) -> object:
    from engine.cameras.reality_capture import csv_in_child

    return csv_in_child(str(folder / "cameras.csv"), str(folder / "arrays.npz"), "The export")


def _read_reality_xmp(folder: Path) -> object:
    from engine.cameras.reality_capture import xmp_in_child

    return xmp_in_child([str(folder / "a.xmp")], str(folder / "arrays.npz"), "The export")


def _write_bundler(folder: Path) -> None:
    lines = ["# Bundle file v0.3", "2 2"]
    for camera in _cameras():
        pose = np.diag([1.0, -1.0, -1.0]) @ camera.viewmat[:3]
        lines += ["35.0 -0.05 0.01", *(" ".join(map(str, row)) for row in (*pose[:, :3], pose[:, 3]))]
    lines += ["0 0 2", "10 20 30", "2 0 0 1.5 2.5 1 0 1.5 2.5", "0.5 0 2", "10 20 30", "1 1 1 1.5 2.5"]
    (folder / "bundle.out").write_text("\n".join(lines) + "\n")
    (folder / "list.txt").write_text("a.jpg\nhall/b.jpg 0 35.0\n")


def _read_bundler(folder: Path) -> object:
    from engine.cameras.bundler import bundler_in_child

    return bundler_in_child(str(folder / "bundle.out"), str(folder / "arrays.npz"), "The export")


def _read_given(folder: Path) -> object:
    """Read given cameras as `reconstruct` does, in a child process for what COLMAP reads."""
    from engine.cameras import read_cameras

    return read_cameras(folder, _photo_set(folder))


def _write_model(folder: Path, *, text: bool = False) -> None:
    import pycolmap

    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(model="OPENCV", width=40, height=30, params=list(_cameras()[0].params))
    lens.camera_id = 1
    model.add_camera_with_trivial_rig(lens)
    for number, camera in enumerate(_cameras(), start=1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(camera.viewmat[:3, :3].copy()), camera.viewmat[:3, 3])
        image = pycolmap.Image(name=camera.photo, camera_id=1, image_id=number)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([5.0, 6.0]))])
        model.add_image_with_trivial_frame(image, pose)
    for number in range(3):
        track = pycolmap.Track()
        if number == 0:
            track.add_element(1, 0)
            track.add_element(2, 0)
        model.add_point3D(np.array([0.1 * number, 0.0, 2.0]), track, np.array([10, 20, 30], np.uint8))
    if text:
        model.write_text(folder)
    else:
        model.write_binary(folder)


def _write_text_model(folder: Path) -> None:
    _write_model(folder, text=True)


def _require_whole(folder: Path) -> object:
    from engine.cameras.model_files import require_whole_files

    require_whole_files(folder, "Copy it again.")
    return True


def _write_label_map(folder: Path) -> None:
    from engine.masks.storage import write_label_map

    write_label_map(folder / "a.jpg.npz", np.arange(12, dtype=np.int32).reshape(3, 4), recipe="recipe")


def _read_label_map(folder: Path) -> object:
    from engine.masks.storage import read_label_map, read_recipe

    read_recipe(folder / "a.jpg.npz")
    return read_label_map(folder / "a.jpg.npz")


def _write_scene(folder: Path) -> None:
    from engine.training import save_gaussians

    save_gaussians(folder, _gaussians(features=16))


def _read_scene(folder: Path) -> object:
    from engine.training import load_gaussians

    return load_gaussians(folder)


def _write_detail(folder: Path) -> None:
    from engine.scene import Detailed, save_detailed

    write_object(folder, arrays=True)
    gaussians, rows = _gaussians()[slice(0, 2)], np.array([0, 1], np.int32)
    save_detailed(folder / "objects" / "vase", Detailed(rows, gaussians.means, rows, gaussians))


def _read_detail(folder: Path) -> object:
    from engine.project.objects import load_object, object_gaussians

    return object_gaussians(folder, load_object(folder, "vase"), _gaussians())


def _write_ply(folder: Path) -> None:
    from engine.formats import write_ply

    write_ply(folder / "scene.ply", _gaussians())


def _write_ply_of_others(folder: Path) -> None:
    """Write a big-endian file with other types and orders of properties, and elements around the Gaussians."""
    names = ["opacity", *(f"rot_{i}" for i in range(4)), "x", "y", "z", *(f"scale_{i}" for i in range(3))]
    names += [f"f_dc_{i}" for i in range(3)]
    types = {"x": "double", "y": "double", "z": "double"}
    header = ["ply", "format binary_big_endian 1.0", "comment made elsewhere", "element camera 2", "property short id"]
    header += [f"element vertex {_N}", *(f"property {types.get(name, 'float')} {name}" for name in names)]
    header += ["property uchar label", "element face 1", "property list uchar int vertex_indices", "end_header", ""]
    row = np.dtype([(name, ">f8" if name in types else ">f4") for name in names] + [("label", "u1")])
    rows = np.ones(_N, row)
    body = np.zeros(2, ">i2").tobytes() + rows.tobytes() + b"\x03" + np.zeros(3, ">i4").tobytes()
    (folder / "scene.ply").write_bytes("\n".join(header).encode() + body)


def _read_ply(folder: Path) -> object:
    from engine.formats import read_ply

    kept = read_ply(folder / "scene.ply", skip_broken=True)
    return kept, read_ply(folder / "scene.ply")


def _write_compressed_ply(folder: Path) -> None:
    shutil.copyfile(FORMATS / "playcanvas.compressed.ply", folder / "scene.ply")


def _write_spz(folder: Path) -> None:
    from engine.formats import write_spz

    write_spz(folder / "scene.spz", _gaussians())


def _read_spz(folder: Path) -> object:
    from engine.formats import read_spz

    return read_spz(folder / "scene.spz")


def _copy(fixture: str, name: str, folder: Path) -> None:
    shutil.copyfile(FORMATS / fixture, folder / name)


def _read_spz_4(folder: Path) -> object:
    from engine.formats import read_spz

    return read_spz(folder / "scene.spz4")


def _read_web(name: str, folder: Path) -> object:
    """Read a SOG, SPLAT or KSPLAT as Blender's import does, with the decoder of the engine."""
    from engine.formats import kind_of, read_other
    from engine.pictures import decode_picture

    return read_other(folder / name, kind_of(folder / name), decode_picture)


def _write_sog_parts(folder: Path) -> None:
    with zipfile.ZipFile(FORMATS / "playcanvas.sog") as archive:
        archive.extractall(folder)


def _write_usd(suffix: str, folder: Path) -> None:
    from engine.formats import write_usd

    write_usd(folder / f"scene.{suffix}", _gaussians())


def _read_usd(suffix: str, folder: Path) -> object:
    from engine.formats import read_usd

    return read_usd(folder / f"scene.{suffix}")


def _write_glb(folder: Path) -> None:
    from engine.formats import FileFacts, write_glb

    facts = FileFacts("vase", rights="CC0", extras={"title": "Vase"})
    write_glb(folder / "scene.glb", _gaussians(), facts)


def _read_glb(folder: Path) -> object:
    from engine.formats import read_glb

    return read_glb(folder / "scene.glb")


def _write_checkpoint(folder: Path) -> None:
    import torch

    from engine.training import AdamState
    from engine.training.checkpoint import RunState, write_checkpoint
    from engine.training.held_out import CurvePoint
    from engine.training.parameters import Parameters
    from engine.training.trials import Trial

    exposure = torch.zeros((2, 3))
    state = RunState(
        parameters=Parameters.from_gaussians(_gaussians(features=4), sh_degree=1, features=True),
        exposure=exposure,
        exposure_moments=AdamState.zeros_like(exposure),
        step=20,
        sh_limit=1,
        trials=[Trial("1", 5, 5, 0.1, True), Trial("2", 10, 5, math.nan, False)],
        transient_masks={0: np.zeros((3, 4), bool)},
        neighbours=torch.zeros((_N, 2), dtype=torch.int32),
        curve=[CurvePoint(10, 1.0, 2.0, 20.0, 0.8, 0.1, _N), CurvePoint(20, 2.0, 4.0, 21.0, math.nan, 0.1, _N)],
        guards=Counter({"clipped": 2}),
        wall_seconds=2.0,
        cpu_seconds=4.0,
    )
    write_checkpoint(folder / "run", "key", state)


def _read_checkpoint(folder: Path) -> object:
    from engine.training.checkpoint import latest_run, read_checkpoint, read_progress

    run = latest_run(folder)
    return None if run is None or read_progress(run) is None else read_checkpoint(run, "key")


_MODEL = ("cameras", "images", "points3D", "rigs", "frames")

SCENE: tuple[Reader, ...] = (
    Reader("photos", _write_photo_set, _read_photo_set, ("photos.json",)),
    Reader("looks", _write_looks, _read_looks, ("looks.json",)),
    Reader("cameras", _write_cameras, _read_cameras, ("cameras/cameras.json", "cameras/points.npz"), share=2.0),
    Reader("cameras-in-blender", _write_cameras, _show_cameras, ("cameras/cameras.json", "cameras/points.npz")),
    Reader("camera", _write_camera, _read_camera, ("camera.json",)),
    Reader("transforms", _write_transforms, _read_export, ("transforms.json",)),
    Reader("metashape", _write_metashape, _read_metashape, ("cameras.xml",)),
    Reader("bundler", _write_bundler, _read_bundler, ("bundle.out", "list.txt")),
    Reader("reality-capture-csv", _write_reality_csv, _read_reality_csv, ("cameras.csv",)),
    Reader("reality-capture-xmp", _write_reality_xmp, _read_reality_xmp, ("a.xmp",)),
    Reader("transforms-with-cloud", _write_transforms, _read_given, ("transforms.json", "points.ply"), share=3.0),
    Reader("colmap-lengths", _write_model, _require_whole, tuple(f"{name}.bin" for name in _MODEL)),
    Reader("colmap-binary", _write_model, _read_given, tuple(f"{name}.bin" for name in _MODEL), share=6.0),
    Reader("colmap-text", _write_text_model, _read_given, tuple(f"{name}.txt" for name in _MODEL), share=6.0),
    Reader("label-map", _write_label_map, _read_label_map, ("a.jpg.npz",)),
    Reader("scene", _write_scene, _read_scene, ("scene.ply", "features.npy"), share=2.0),
    Reader("detail", _write_detail, _read_detail, ("objects/vase/detail.npz",), share=2.0),
    Reader("hand-membership", _write_hand_membership, _read_hand_membership, ("membership.npy",)),
    Reader("measurement", _write_measurement, _load_measurement, ("measurement.json",)),
    Reader("ply", _write_ply, _read_ply, ("scene.ply",)),
    Reader("ply-of-others", _write_ply_of_others, _read_ply, ("scene.ply",)),
    Reader("ply-compressed", _write_compressed_ply, _read_ply, ("scene.ply",)),
    Reader("spz", _write_spz, _read_spz, ("scene.spz",)),
    # The package is optional; Blender has it.
    *(
        (Reader("spz-4", partial(_copy, "niantic_4.spz", "scene.spz4"), _read_spz_4, ("scene.spz4",)),)
        if importlib.util.find_spec("zstandard")
        else ()
    ),
    Reader(
        "sog", partial(_copy, "playcanvas.sog", "scene.sog"), partial(_read_web, "scene.sog"), ("scene.sog",), share=2.0
    ),
    Reader("sog-parts", _write_sog_parts, partial(_read_web, "meta.json"), ("meta.json", "means_l.webp", "sh0.webp")),
    Reader("splat", partial(_copy, "gsplat.splat", "scene.splat"), partial(_read_web, "scene.splat"), ("scene.splat",)),
    *(
        Reader(
            f"ksplat-{level}",
            partial(_copy, f"level_{level}.ksplat", "scene.ksplat"),
            partial(_read_web, "scene.ksplat"),
            ("scene.ksplat",),
        )
        for level in (0, 1, 2)
    ),
    Reader("glb", _write_glb, _read_glb, ("scene.glb",), share=2.0),
    # OpenUSD is optional.
    *(
        Reader(f"usd-{suffix[3:]}", partial(_write_usd, suffix), partial(_read_usd, suffix), (f"scene.{suffix}",))
        for suffix in ("usda", "usdc")
        if importlib.util.find_spec("pxr")
    ),
    Reader("checkpoint", _write_checkpoint, _read_checkpoint, ("run/training.npz",), share=2.0),
)
