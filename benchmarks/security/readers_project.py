"""Readers of the project folder and of jobs: JSON files, objects, candidates, caches."""

from __future__ import annotations

import inspect
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn
from unittest import mock

import numpy as np
from scipy.sparse import csr_matrix

from tests.engine.finished_project import write_finished_project

from .reader import Reader, addon

_FIGURES: dict[str, Any] = {
    "photos": {"n_photos": 2, "rejected": []},
    "training": {
        "preset": "preview",
        "steps": 100,
        "n_gaussians": 3,
        "held_out": ["a.jpg"],
        "curve": [
            {
                "step": 50,
                "wall_seconds": 1.5,
                "cpu_seconds": 2.5,
                "psnr": 21.5,
                "ssim": 0.8,
                "l1": 0.1,
                "n_gaussians": 3,
            },
            {
                "step": 100,
                "wall_seconds": 3.5,
                "cpu_seconds": 5.5,
                "psnr": 23.5,
                "ssim": 0.9,
                "l1": 0.05,
                "n_gaussians": 3,
            },
        ],
        "trials": [{"what": "exposure", "step": 10, "n_steps": 5, "gain": 0.1, "kept": False}],
        "stopped_early": {"planned_steps": 300, "expected_gain": 0.01, "limit": 0.05, "wall_seconds_saved": 9.0},
    },
    "objects": {"refused": {"cup": "No cup was found."}},
}
_FORECAST = dict.fromkeys(("seconds", "low", "high", "memory", "memory_low", "memory_high"), 5)


def write_project(folder: Path) -> None:
    """Write a ``project.json`` with everything that it may hold, and a file that a stage recorded."""
    from engine.project.folder import ProjectFolder

    output = folder / "gaussians" / "scene.ply"
    with ProjectFolder.create(folder) as project:
        output.parent.mkdir()
        output.write_bytes(b"ply")
        for stage, figures in _FIGURES.items():
            outputs = [output] if stage == "training" else []
            project.finish_stage(stage, "k" * 8, wall_seconds=2.0, cpu_seconds=3.0, figures=figures, outputs=outputs)
        project.put("photo_folder", "photos")
        project.put("engine_version", "1")
        project.put("objects_by_prompt", {"key": "k", "found": {"vase": ["vase"]}, "again": {"vase": ["vase", None]}})
        project.put("work_plan", {"preset": "preview", "steps": 100, "left_out": [{"what": "a", "why": "b"}]})
        project.put("forecast", {"stages": [{"stage": "training", **_FORECAST}]})
        project.put(
            "plan",
            {
                "held_out": ["a.jpg"],
                "mask_photos": ["b.jpg"],
                "features": True,
                "left_out": [{"what": "a", "why": "b", "saved": "c"}],
            },
        )


def write_object(folder: Path, arrays: bool = False) -> None:
    """Write an object of a scene of three Gaussians. Its files are not recorded, so that their readers are reached."""
    from engine.project.objects import ObjectRecord, write_record

    record = ObjectRecord(
        id="vase", name="vase", prompt={"kind": "click", "photo": "a.jpg", "x": 5.0, "y": 6.0, "clicks": [{"x": 1}]},
        threshold=0.5, score=0.9, fit=0.8, n_gaussians=2, n_scene_gaussians=3,
        evidence=({"photo": "a.jpg", "score": 0.9},),
        settings={"cosine": 0.5}, seconds=1.5, created="2026-01-01T00:00:00.000000+00:00", level=1,
        levels=({"n_gaussians": 1}, {"n_gaussians": 2}),
        refined=({"clicks": [{"photo": "a.jpg", "x": 1.0, "y": 2.0}]},),
    )  # fmt: skip
    write_record(folder / "objects" / "vase" / "object.json", record, {})
    if arrays:
        levels = np.array([[1, 0, 0], [1, 1, 0]], np.float32)
        np.save(folder / "objects" / "vase" / "membership.npy", levels[1])
        np.save(folder / "objects" / "vase" / "levels.npy", levels)


def _write_events(folder: Path) -> None:
    from engine.core import events

    lines = (
        events.StageStarted("training"), events.Progress("training", 0.5, 12.0, "half"),
        events.StageFinished("training", 3.0),
        events.Metric("training", "psnr", 23.5, 100, 2.5), events.Preview("training", "out/a.png"),
        events.Warned("careful"),
        events.ErrorEvent("It failed.", "DiskError"), events.Finished("done", {"project": "out", "models": {"a": "b"}}),
    )  # fmt: skip
    (folder / "events.jsonl").write_text(
        "".join(events.to_json_line(event) + "\n" for event in lines), encoding="utf-8"
    )


def _read_events(folder: Path) -> object:
    from engine.core.events import from_json_line

    lines = (folder / "events.jsonl").read_bytes().decode("utf-8", "replace").splitlines()
    return [event for event in map(from_json_line, lines) if event is not None] or None


def _write_job(folder: Path) -> None:
    """Write the files of a job that ended without a last event."""
    _write_events(folder)
    file = folder / "events.jsonl"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-2]))
    # No process has this number: Linux counts to 4,194,304.
    record = {"kind": "import", "subject": "out", "pid": 4_999_999, "command": ["python", "-m", "engine"]}
    (folder / "job.json").write_text(json.dumps(record))
    (folder / "errors.txt").write_text("Traceback\nOSError: no\n")


def _poll(folder: Path) -> object:
    from engine.workers.jobs import Job

    job = Job.attach(folder)
    if job is None:
        return None
    state = job.poll()
    return state, state.progress_line()


def _write_waiting_job(folder: Path) -> None:
    record = {"kind": "import", "subject": "out", "command": ["python", "-m", "engine"]}
    (folder / "1.json").write_text(json.dumps(record))


def _stored_jobs(folder: Path) -> object:
    from engine.workers.jobs import WaitingJobs

    jobs = WaitingJobs(lambda: folder)
    jobs.find()
    return list(jobs) or None


def _read_project(folder: Path) -> object:
    from engine.project.folder import ProjectFolder

    project = ProjectFolder.open_existing(folder)
    return [(project.stage_record(stage), project.damaged_outputs(stage)) for stage in _FIGURES]


def _lock_project(folder: Path) -> object:
    from engine.project.folder import ProjectFolder

    with ProjectFolder.create(folder) as project:
        project.forget_stages(["objects"])
    return True


def _collect_facts(folder: Path, *, draws: bool = True) -> object:
    """Write the page of the report with its plot, which takes a second."""
    from engine.core.language import languages
    from engine.delivery.report.facts import collect_facts
    from engine.delivery.report.page import Pictures, page
    from engine.delivery.report.plots import error_curve
    from engine.project.folder import ProjectFolder

    facts, language = collect_facts(ProjectFolder.open_existing(folder)), languages()[-1]
    measured = facts["training"].get("curve") or []
    curves = {language.code: error_curve(measured, language.translated)} if draws else {}
    return page(facts, Pictures(curves=curves), language)


def _collect_facts_without_plot(folder: Path) -> object:
    return _collect_facts(folder, draws=False)


def _write_reported_project(folder: Path) -> None:
    """Write a project with figures of all stages, whose outputs are left out, and an object."""
    whole = write_finished_project(folder / "whole")
    (whole / "project.json").rename(folder / "project.json")
    shutil.rmtree(folder / "whole")
    write_object(folder)


def _store_forecast(folder: Path) -> object:
    from engine.pipeline.planning import planned_work
    from engine.project.folder import ProjectFolder

    work: Any = None
    forecast: Any = SimpleNamespace(stages=[SimpleNamespace(stage="masks")])
    with (
        mock.patch.object(planned_work, "work_plan_as_dict", lambda work: {"preset": "best"}),
        mock.patch.object(planned_work, "forecast_as_dict", lambda forecast: {"stages": []}),
    ):
        planned_work.store_forecast(ProjectFolder.open_existing(folder), work, forecast)
    return True


def _stored_curve(folder: Path) -> object:
    curve = addon("project.curve")
    points = inspect.unwrap(curve.stored_curve)(folder)
    return curve.curve_picture(points) if points else None


def _list_objects(folder: Path) -> object:
    from engine.project.objects import forget_unreadable_record, is_object_intact, list_objects, load_object

    objects = list_objects(folder)
    forget_unreadable_record(folder, "vase")
    return load_object(folder, "VASE") if objects and is_object_intact(folder, "vase") else None


def _show_objects(folder: Path) -> object:
    from engine.project.content import shown_objects
    from engine.project.objects import load_level, load_membership, require_intact

    objects = shown_objects(folder)
    require_intact(folder, "vase")
    return [
        load_membership(folder, "vase", 3),
        *(load_level(folder, "vase", one.level, 3) for one in objects),
    ]


def _read_memberships(folder: Path) -> object:
    from engine.project.objects import load_levels, load_membership

    return load_membership(folder, "vase"), load_levels(folder, "vase")


def _write_trash(folder: Path) -> None:
    entry = folder / "trash" / "20260101-000000-vase"
    write_object(folder)
    entry.mkdir(parents=True)
    (folder / "objects" / "vase").rename(entry / "object")
    info = {
        "version": 1,
        "id": "vase",
        "name": "vase",
        "deleted": "2026-01-01T00:00:00+00:00",
        "why": "test",
        "scene": None,
    }
    (entry / "trash.json").write_text(json.dumps(info))


def _list_trash(folder: Path) -> object:
    from engine.project.objects import list_trash

    return list_trash(folder)


def _write_museum_record(folder: Path) -> None:
    from engine.project.objects import MuseumRecord, save_record

    save_record(folder, "vase", MuseumRecord("1900.1", "Vase", "CC0", "Blue."))


def _load_museum_record(folder: Path) -> object:
    from engine.project.objects import load_record

    return load_record(folder, "vase").as_comments()


def _write_candidates(folder: Path) -> None:
    entry = {
        "number": 1,
        "text": "cup",
        "score": 0.4,
        "photo": "a.jpg",
        "x": 5.5,
        "y": 6.5,
        "box": [1.0, 2.0, 9.0, 9.0],
    }
    entry |= {"n_gaussians": 2, "n_scene_gaussians": 10, "detector": "offline-vocabulary"}
    entry |= {"graph": "a1", "fingerprint": "features 1"}
    entry |= {"picture": "objects/_candidates/1.png"}
    refused = [{"text": "cup", "message": "No cup was found."}]
    (folder / "objects" / "_candidates").mkdir(parents=True)
    sets = {"members": np.packbits(np.arange(10) < 2), "undecided": np.packbits(np.arange(10) > 8)}
    mask, example = np.packbits(np.eye(12, dtype=bool), axis=1), np.linspace(-1, 1, 6, dtype=np.float32)
    file = folder / "objects" / "_candidates" / "1.npz"
    np.savez_compressed(file, width=12, mask=mask, example=example, **sets)
    data = {"version": 1, "created": "2026-01-01", "refused": refused, "candidates": [entry]}
    (folder / "objects" / "candidates.json").write_text(json.dumps(data))


def _load_candidate(folder: Path) -> object:
    from engine.objects.candidate_file import load_candidate, remember_candidates

    found = load_candidate(folder, 1)
    remember_candidates(folder, "mug", "No mug was found.", (), None)
    return found


def _write_own_words(folder: Path) -> None:
    from engine.project.own_words import Example, OwnWords

    vector = np.linspace(-1, 1, 6, dtype=np.float32)
    example = Example("mask", "a1", "b2", "offline-vocabulary", "features 1", "2026-01-01", vector)
    OwnWords(folder / "own_words.json").add([example])


def _read_own_words(folder: Path) -> object:
    from engine.project.own_words import OwnWords

    own = OwnWords(folder / "own_words.json")
    own.import_from(own.file)
    return [(one.word, one.vector.tolist()) for one in own.examples()]


def _show_candidates(folder: Path) -> object:
    from engine.project.refused_prompts import read_not_found

    return inspect.unwrap(read_not_found)(folder)


def _write_kept(folder: Path) -> None:
    from engine.core.files import keep_arrays

    keep_arrays(folder / "kept.npz", "recipe", {"a": np.zeros((2, 3), np.float32), "b": np.array(["x", "y"])})


def _read_kept(folder: Path) -> object:
    from engine.core.files import ArraySpec, read_kept_arrays

    specs = {"a": ArraySpec("float32", ("n", 3)), "b": ArraySpec("str", ("n",))}
    return read_kept_arrays(folder / "kept.npz", "recipe", specs)


_PIXELS = np.zeros((48, 64, 3), np.uint8)


class _NotStored(Exception):
    """A cached array was ignored, so that it would be computed."""


def _encode(folder: Path) -> object:
    """Read an embedding. Computing one is the answer to a damaged file."""
    from engine.masks.embeddings import EmbeddingFolder
    from engine.masks.sam import Embedding

    def encode(pixels: object) -> NoReturn:
        raise _NotStored

    sam: Any = SimpleNamespace(name="sam", encode=encode)
    if not any(folder.iterdir()):
        sam.encode = lambda pixels: Embedding(np.zeros((1, 256, 64, 64), np.float32), 48, 64, 16.0)
    try:
        return EmbeddingFolder(folder).encode("a.jpg", _PIXELS, sam)
    except _NotStored:
        return None


def _write_embedding(folder: Path) -> None:
    _encode(folder)
    # As the engine's, but compressed: 2 MB of zeros would make each input slow.
    file = folder / "a.jpg.sam.npz"
    with np.load(file) as stored:
        arrays = dict(stored)
    np.savez_compressed(file, **arrays)


def _make_looks(folder: Path) -> object:
    """Read the looks of proposals. Making them is the answer to a damaged file."""
    from engine.objects import SegmentationContext, looks
    from engine.objects.graph import SceneGraph
    from engine.objects.settings import BETTER

    def build(*_: object, **__: object) -> object:
        if any(folder.iterdir()):
            raise _NotStored
        numbers, ones = np.array([0, 1], np.int32), np.ones(2, np.float32)
        members = np.array([[True, False, True], [False, True, False]])
        sightings = (numbers, ("a.jpg",) * 2, np.ones((2, 2, 2), np.float32), np.ones((2, 4), np.float32))
        return looks.Looks(members, ones, numbers, *sightings)

    links, segments = csr_matrix(np.zeros((3, 3), np.float32)), csr_matrix(np.ones((3, 2), np.float32))
    graph = SceneGraph(links, segments, np.zeros(2, np.int32), ("a.jpg",))
    others: Any = SimpleNamespace(name="detector", scene=SimpleNamespace(gaussians=SimpleNamespace(means=range(3))))
    context = SegmentationContext(others, others, {}, BETTER, lambda: others, folder=folder, kept={"graph": graph})
    with mock.patch.object(looks, "build_looks", build):
        try:
            return looks.load_or_build_looks(context)
        except _NotStored:
            return None


def _link_gaussians(folder: Path) -> object:
    """Read the graph of a scene. Building it is the answer to a damaged file."""
    from engine.objects import graph_file
    from engine.objects.graph import SceneGraph

    def build(*_: object, **__: object) -> object:
        if any(folder.iterdir()):
            raise _NotStored
        links = csr_matrix(np.array([[0, 1, 0], [1, 0, 2], [0, 2, 0]], np.float32))
        pixels = csr_matrix(np.array([[0, 1, 0], [3, 0, 2], [0, 2, 4]], np.float32))
        return SceneGraph(links, pixels, np.array([0, 0, 1], np.int32), ("a.jpg", "b.jpg"))

    array, segments = np.zeros((3, 2), np.float32), np.ones((2, 2), np.int32)
    gaussians = SimpleNamespace(means=array, opacities=array, features=array)
    cameras = SimpleNamespace(cameras=[SimpleNamespace(photo="a.jpg")])
    views: Any = SimpleNamespace(scene=_ThreeGaussians(gaussians), cameras=cameras, render_side=2)
    with mock.patch.object(graph_file, "build_graph", build):
        try:
            return graph_file.load_or_build_graph(
                folder / "graph.npz", views, {"a.jpg": segments}, n_views=2, should_stop=lambda: False
            )
        except _NotStored:
            return None


@dataclass(frozen=True)
class _ThreeGaussians:
    gaussians: object

    def __len__(self) -> int:
        return 3


def _calibration(folder: Path, *, again: bool = True) -> object:
    from engine.core.system import Machine
    from engine.pipeline.planning.calibration import Benchmark, load_calibration

    def measure() -> Benchmark:
        if again:
            raise _NotStored
        return Benchmark(0.03, 2.0, 1.5, 400_000_000, "1")

    machine = Machine(2, 8_000_000_000, "cpu", "test")
    try:
        calibration = load_calibration(machine, rasterizer="1", measure=measure, file=folder / "calibration.json")
    except _NotStored:
        return None
    calibration.add_outcome("training", "cpu", formula=100.0, actual=120.0)
    calibration.save()
    return [calibration.slowdown(stage) for stage in ("photos", "cameras", "masks", "training")]


PROJECT = (
    Reader("events", _write_events, _read_events, ("events.jsonl",), takes_text=True),
    Reader("job", _write_job, _poll, ("job.json", "events.jsonl", "errors.txt")),
    Reader("waiting-job", _write_waiting_job, _stored_jobs, ("1.json",)),
    Reader("project", write_project, _read_project, ("project.json",), share=2.0),
    Reader("project-lock", write_project, _lock_project, ("project.json",)),
    Reader(
        "report",
        _write_reported_project,
        _collect_facts_without_plot,
        ("project.json", "objects/vase/object.json"),
        share=2.0,
    ),
    Reader("report-plot", _write_reported_project, _collect_facts, ("project.json",)),
    Reader("forecast", write_project, _store_forecast, ("project.json",)),
    Reader("curve", write_project, _stored_curve, ("project.json",)),
    Reader("objects", lambda folder: write_object(folder, arrays=True), _list_objects, ("objects/vase/object.json",)),
    Reader(
        "objects-in-blender",
        lambda folder: write_object(folder, arrays=True),
        _show_objects,
        tuple(f"objects/vase/{name}" for name in ("object.json", "membership.npy", "levels.npy")),
        share=2.0,
    ),
    Reader(
        "memberships",
        lambda folder: write_object(folder, arrays=True),
        _read_memberships,
        ("objects/vase/membership.npy", "objects/vase/levels.npy"),
    ),
    Reader("trash", _write_trash, _list_trash, ("trash/20260101-000000-vase/trash.json",)),
    Reader("museum-record", _write_museum_record, _load_museum_record, ("objects/vase/record.json",)),
    Reader("candidates", _write_candidates, _load_candidate, ("objects/candidates.json", "objects/_candidates/1.npz")),
    Reader("own-words", _write_own_words, _read_own_words, ("own_words.json",)),
    Reader("candidates-in-blender", _write_candidates, _show_candidates, ("objects/candidates.json",)),
    Reader("kept-arrays", _write_kept, _read_kept, ("kept.npz",)),
    Reader("embedding", _write_embedding, _encode, ("a.jpg.sam.npz",)),
    Reader("groups", _make_looks, _make_looks, ("looks.npz",)),
    Reader("graph", _link_gaussians, _link_gaussians, ("graph.npz",)),
    Reader("calibration", lambda folder: _calibration(folder, again=False), _calibration, ("calibration.json",)),
)
