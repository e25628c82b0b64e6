"""A small finished project with two objects, as the present version stores it, without training or Segment Anything."""

from __future__ import annotations

import atexit
import functools
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from engine.cameras import read_cameras
from engine.core.files import write_json
from engine.masks import label_map_path
from engine.masks.storage import write_label_map
from engine.photos import inspect_photos, read_photos
from engine.photos.settings import PhotoSettings
from engine.project.folder import ProjectFolder
from engine.project.objects import MuseumRecord, ObjectRecord, save_object, save_record
from engine.scene import Detailed, Gaussians, write_camera_set, write_photo_set
from engine.training import save_gaussians
from tests.engine.museum import VIEWS, write_cameras, write_photos

N_GAUSSIANS = 400
"""One at each point of the given cameras."""
_SIZE = (256, 192)
_OBJECTS = {
    "box": {"kind": "box", "photo": "view_08.jpg", "x0": 48.0, "y0": 80.0, "x1": 160.0, "y1": 188.0},
    "teapot": {"kind": "click", "photo": "view_08.jpg", "x": 106.0, "y": 128.0},
}
"""Objects and their prompts; each has 9 Gaussians of its own, and a level of 5 of them."""
_CURVE = [
    {
        "step": step, "wall_seconds": step / 100, "cpu_seconds": step / 90, "psnr": 14.0 + step / 100, "ssim": 0.4,
        "l1": 0.1, "n_gaussians": N_GAUSSIANS,
    }
    for step in (10, 22, 48, 105, 229, 500)
]  # fmt: skip
_TRAINING: dict[str, Any] = {
    "steps": 500, "n_gaussians": N_GAUSSIANS, "psnr": 19.0, "ssim": 0.4, "l1": 0.1, "sh_degree": 0, "preset": "test",
    "held_out": ["view_10.jpg"], "measured_photos": ["view_10.jpg"], "validation_photos": [], "n_background": 0,
    "guards": {}, "limits": {"scales_at_limit": 18}, "features": True, "curve": _CURVE,
    "trials": [{"what": "exposure", "step": 125, "n_steps": 12, "gain": 0.007, "kept": False}],
    "stopped_early": {"planned_steps": 900, "expected_gain": 0.01, "limit": 0.05, "wall_seconds_saved": 9.0},
}  # fmt: skip
_PLAN = {"n_photos": 5, "width": 128, "height": 96, "n_pairs": 0, "n_mask_photos": 5, "max_gaussians": N_GAUSSIANS}


def write_finished_project(folder: Path, *, recorded: bool = True) -> Path:
    """Write ``photos``, ``transforms.json``, ``points.ply`` and ``project`` to `folder`, and return the project.

    Without `recorded`, no sizes and hashes of its files are stored, so that a changed file reaches its reader: whoever
    changes a file with bad intent changes what is recorded of it, too.
    """
    shutil.copytree(_template(), folder, dirs_exist_ok=True)
    path = folder / "project"
    for name, setting in (("project.json", "photo_folder"), ("photos/photos.json", "folder")):
        _edit(path / name, lambda stored, setting=setting: stored.update({setting: str(folder / "photos")}))
    project = ProjectFolder.open_existing(path)
    project.record_outputs("photos", [path / "photos" / "photos.json"])
    if not recorded:
        _edit(path / "project.json", lambda stored: [stage["outputs"].clear() for stage in stored["stages"].values()])
        for name in _OBJECTS:
            _edit(path / "objects" / name / "object.json", lambda stored: stored["files"].clear())
    return path


def _edit(file: Path, change: Callable[[Any], object]) -> None:
    stored = json.loads(file.read_text(encoding="utf-8"))
    change(stored)
    write_json(file, stored)


# Reading photos and cameras takes a second or two, in child processes.
@functools.cache
def _template() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="finished-project-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    photos = write_photos(folder / "photos", size=_SIZE)
    transforms = write_cameras(folder, {f"view_{view:02}.jpg": view for view in VIEWS})
    path = folder / "project"
    photo_set = read_photos(photos, PhotoSettings())
    camera_set = read_cameras(transforms, photo_set)
    names = [photo.name for photo in photo_set.photos]
    with ProjectFolder.create(path) as project:
        write_photo_set(path / "photos" / "photos.json", photo_set)
        write_json(path / "photos" / "looks.json", [asdict(photo) for photo in inspect_photos(photo_set)])
        write_camera_set(path / "cameras", camera_set)
        maps = [label_map_path(path / "masks", name) for name in names]
        for file in maps:
            labels = np.zeros(_SIZE[::-1], np.int32)
            labels[80:188, 48:160], labels[110:150, 90:130] = 1, 2
            write_label_map(file, labels)
        gaussians = _gaussians(camera_set.points)
        save_gaussians(path / "gaussians", gaussians)
        outputs = {
            "photos": [path / "photos" / name for name in ("photos.json", "looks.json")],
            "cameras": [path / "cameras" / name for name in ("cameras.json", "points.npz")],
            "masks": maps,
            "training": [path / "gaussians" / name for name in ("scene.ply", "features.npy")],
        }
        figures: dict[str, dict[str, Any]] = {
            "photos": {"n_photos": len(names), "rejected": []},
            "cameras": {"n_registered": len(names), "unregistered": [], "poses_given": True, "n_points": N_GAUSSIANS},
            "masks": {"n_photos": len(names), "seconds_per_photo": 5.9},
            "training": _TRAINING,
            "objects": {"found": {}, "refused": {"vase": "Nothing in the photos looks enough like 'vase'."}},
        }
        for stage, found in figures.items():
            project.finish_stage(
                stage, stage, wall_seconds=2.0, cpu_seconds=3.0, figures=found, outputs=outputs.get(stage, ())
            )
        project.put("photo_folder", str(photos))
        project.put("training_sizes", {"test": {}})
        plan = {**_PLAN, "preset": "test", "pairs": "none", "features": True, "sh_degree": 0, "steps": 500}
        project.put("work_plan", plan)
        forecast = dict.fromkeys(("seconds", "low", "high", "memory", "memory_low", "memory_high"), 5.0)
        project.put("forecast", {"stages": [{"stage": stage, **forecast} for stage in figures]})
        left_out = [{"what": "structure from motion", "why": "camera poses were given"}]
        kept = {"held_out": ["view_10.jpg"], "mask_photos": names, "features": True, "left_out": left_out}
        project.put("plan", kept)
    for first, (name, prompt) in enumerate(_OBJECTS.items()):
        _write_object(path, name, prompt, gaussians, 9 * first)
    save_record(path, "teapot", MuseumRecord(title="Teapot", catalogue_number="1925.7"))
    return folder


def _gaussians(means: np.ndarray) -> Gaussians:
    rng = np.random.default_rng(1)
    count = len(means)
    assert count == N_GAUSSIANS
    return Gaussians(
        means=np.asarray(means, np.float32),
        log_scales=np.full((count, 3), -3.0, np.float32),
        quats=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        opacity_logits=np.full(count, 2.0, np.float32),
        sh=rng.normal(0.0, 0.5, (count, 1, 3)).astype(np.float32),
        features=rng.normal(0.0, 1.0, (count, 16)).astype(np.float32),
    )


def _write_object(project: Path, name: str, prompt: dict[str, Any], gaussians: Gaussians, first: int) -> None:
    levels = np.zeros((2, N_GAUSSIANS), np.float32)
    levels[0, first : first + 5] = levels[1, first : first + 9] = 0.9
    record = ObjectRecord(
        id=name, name=name, prompt=prompt, threshold=0.5, score=0.9, fit=0.4, n_gaussians=9,
        n_scene_gaussians=N_GAUSSIANS, evidence=({"photo": "view_08.jpg", "score": 0.9},), seconds=1.6,
        created="2026-11-23T01:05:54+00:00", level=1, levels=({"n_gaussians": 5}, {"n_gaussians": 9}),
    )  # fmt: skip
    rows = np.arange(first, first + 9, dtype=np.int32)
    own = gaussians[rows]
    detailed = Detailed(rows, own.means, rows, replace(own, features=None))
    save_object(project, record, levels[1], levels=list(levels), detailed=detailed)
