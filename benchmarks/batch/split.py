"""One project on several workers: seconds of matching, masks and detail, and whether the bits are those of one."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import shutil
import sqlite3
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from engine.cameras.features import SfmWorkspace, match_features
from engine.cameras.matching import match_pairs
from engine.cameras.settings import CameraSettings
from engine.core.events import ignore_events, never_stop
from engine.core.shares import helped_by
from engine.core.system import CORES_VARIABLE, describe_machine, usable_cores, use_cores
from engine.masks import label_map_path, load_default_sam, load_sam, make_masks, make_masks_with_helpers
from engine.masks.settings import MaskSettings
from engine.objects import MaskPrompt, Segmenter
from engine.objects.grounding import load_default_detector
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder
from engine.project.objects import list_objects
from engine.quality.evaluation import read_ground_truth
from engine.scene import read_camera_set, read_photo_set, write_photo_set
from engine.workers.batch.helpers import ClusterHelpers

from ..rooms.keeping import unpack_kept
from ..scale.sets import set_of
from .runs import Cluster

_PHOTOS, _PHOTOS_FILE = "building_60", "photos.json"
_ROOM = "room_6"
_N_OBJECTS = 8
_STEPS = 300
"""Steps of detail, a fifth of a user's: what does not grow with them weighs more."""
_WORKS = ("matching", "masks", "detail")


def measure_split(work: Path, workers: int, cores_each: int, first_core: int) -> None:
    """Do the three works on `cores_each` cores for each of `workers`, and keep the seconds in ``WORK/split/N.json``."""
    cores = usable_cores()[first_core : first_core + workers * cores_each]
    if len(cores) < workers * cores_each:
        raise RuntimeError(f"This computer has no {workers * cores_each} cores from number {first_core} on.")
    of_workers = [cores[start : start + cores_each] for start in range(0, len(cores), cores_each)]
    machine = describe_machine().name
    database, room = _prepared(work)
    own = work / "split" / f"run_{workers}"
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    shutil.copytree(room, own / "room")
    shutil.copyfile(database, own / "database.db")
    shutil.copyfile(work / "split" / _PHOTOS_FILE, own / _PHOTOS_FILE)
    cluster = Cluster(own / "cluster")
    cluster.start_scheduler()
    try:
        # The engine itself runs on one of the workers, here in this process.
        for own_cores in of_workers[1:]:
            cluster.start_worker(environment={CORES_VARIABLE: ",".join(map(str, own_cores))})
        while len(cluster.worker_processes()) < workers - 1:
            time.sleep(0.2)
        use_cores(of_workers[0])
        with helped_by(functools.cache(lambda: ClusterHelpers(cluster.address))):
            result = {"workers": workers, "cores_each": cores_each, "machine": machine}
            for name, work_of in zip(_WORKS, _FUNCTIONS, strict=True):
                result[name] = _timed(work_of, own)
                # A measurement that is ended keeps the works that it has done.
                (work / "split" / f"{workers}.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    finally:
        cluster.stop()


def _timed(work_of: Callable[[Path], Any], own: Path) -> dict[str, Any]:
    begin = time.perf_counter()
    digest = work_of(own)
    seconds = time.perf_counter() - begin
    sys.stderr.write(f"{work_of.__name__} {seconds:.1f} s\n")
    return {"seconds": seconds, "sha256": hashlib.sha256(digest).hexdigest()}


def _prepared(work: Path) -> tuple[Path, Path]:
    """Return a database with features and matches, and a trained room with objects; kept for the next time."""
    photos = set_of(_PHOTOS, work)
    workspace = SfmWorkspace(work / "split" / "sfm", photos.photos, CameraSettings())
    write_photo_set(work / "split" / _PHOTOS_FILE, photos.photos)
    match_features(workspace, report=lambda done, message: None, should_stop=never_stop)
    room = work / "split" / "room"
    if not room.exists():
        unpack_kept(_ROOM, room)
    project = ProjectFolder.open_existing(room / "project")
    if len(list_objects(project.path)) < _N_OBJECTS:
        _store_objects(project, room)
        # Compiles the kernels, which is done once on a computer.
        spare = shutil.copytree(room, work / "split" / "spare")
        _segmenter(ProjectFolder.open_existing(spare / "project"), steps=20).detail([list_objects(project.path)[0].id])
        shutil.rmtree(spare)
    return workspace.database, room


def _store_objects(project: ProjectFolder, room: Path) -> None:
    """Store objects, each by its true mask in the photo that shows most of it."""
    placed = [camera.photo for camera in read_camera_set(project.path / "cameras").cameras]
    truth = read_ground_truth(room / "truth", placed)
    masks = {photo: truth.masks(photo) for photo in truth.photos}
    project.put("photo_folder", str(room / "photos"))
    segmenter = _segmenter(project)
    for name in truth.objects[:_N_OBJECTS]:
        photo = max(masks, key=lambda one: np.count_nonzero(masks[one].get(name, False)))
        file = room / f"{name}.png"
        Image.fromarray(np.uint8(255) * masks[photo][name]).save(file)
        segmenter.segment(MaskPrompt(photo, file), name)


def _segmenter(project: ProjectFolder, *, steps: int = _STEPS) -> Segmenter:
    settings = replace(BETTER, detail_steps=steps)
    return Segmenter(project, settings, load_default_detector, load_default_sam, ignore_events, never_stop)


def _matching(own: Path) -> bytes:
    with contextlib.closing(sqlite3.connect(own / "database.db")) as opened, opened:
        names = dict(opened.execute("SELECT image_id, name FROM images"))
        ids = [row for (row,) in opened.execute("SELECT pair_id FROM matches ORDER BY pair_id")]
        opened.execute("DELETE FROM matches")
        opened.execute("DELETE FROM two_view_geometries")
    # As COLMAP joins the numbers of two photos.
    pairs = sorted((names[one // 2147483647], names[one % 2147483647]) for one in ids)
    match_pairs(own / "database.db", pairs, CameraSettings(), report=lambda done: None, should_stop=never_stop)
    with contextlib.closing(sqlite3.connect(own / "database.db")) as opened:
        tables = [list(opened.execute(f"SELECT * FROM {table}")) for table in ("matches", "two_view_geometries")]
    return repr(tables).encode()


def _masks(own: Path) -> bytes:
    file, settings, masks = own / _PHOTOS_FILE, MaskSettings(), own / "masks"
    photo_set = replace(read_photo_set(file), folder=own.parents[1] / _PHOTOS)
    names = [photo.name for photo in photo_set.photos]
    make_masks_with_helpers(photo_set, file, names, masks, settings, emit=ignore_events, should_stop=never_stop)
    load = functools.partial(load_sam, settings.model, may_use_gpu=False)
    make_masks(photo_set, names, masks, settings, load, emit=ignore_events, should_stop=never_stop)
    return b"".join(label_map_path(masks, name).read_bytes() for name in names)


def _detail(own: Path) -> bytes:
    project = ProjectFolder.open_existing(own / "room" / "project")
    project.put("photo_folder", str(own / "room" / "photos"))
    _segmenter(project).detail()
    return b"".join(file.read_bytes() for file in sorted((project.path / "objects").glob("*/detail.npz")))


_FUNCTIONS = (_matching, _masks, _detail)


def split_table(work: Path) -> str:
    """Return the table of what was measured, with as many cores for each worker as in the first file."""
    found = [json.loads(file.read_text(encoding="utf-8")) for file in sorted((work / "split").glob("[0-9]*.json"))]
    first = found[0]
    each = first.get("cores_each", 1)
    lines = [
        f"Matching and label maps of the set `{_PHOTOS}` of docs/many_photos.md, detail of {_N_OBJECTS} objects of a "
        f"choosing room ({_STEPS} steps each). Every worker has {each} core{'s' if each > 1 else ''}; the engine runs "
        f"on one of them. {first['machine']}.",
        "",
        f"| workers | {' | '.join(f'{name}, s | against one' for name in _WORKS)} | bits |",
        f"| ---: | {'---: | ---: | ' * len(_WORKS)}--- |",
    ]
    for one in (one for one in found if one.get("cores_each", 1) == each):
        both = {name: (first[name], one[name]) for name in _WORKS if name in one and name in first}
        cells = [
            f"{both[name][1]['seconds']:.1f} | {both[name][0]['seconds'] / both[name][1]['seconds']:.2f}"
            if name in both
            else " | "
            for name in _WORKS
        ]
        same = bool(both) and all(alone["sha256"] == shared["sha256"] for alone, shared in both.values())
        bits = "those of one" if same else "others" if both else ""
        lines.append(f"| {one['workers']} | {' | '.join(cells)} | {bits} |")
    return "\n".join([*lines, ""])
