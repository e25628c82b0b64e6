"""Writes the report of a project: ``report/report.json``, and a page in each language."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras import training_pinhole
from ...core.errors import FormatError, ObjectError, PhotoError
from ...core.files import delete_derived, finite_or_null, write_file, write_json
from ...core.language import languages
from ...core.parts import part
from ...pictures import Scene, write_png
from ...project.content import report_file
from ...project.folder import ProjectFolder
from ...project.objects import list_objects, load_membership, object_gaussians
from ...rasterizer.settings import Backend
from ...scene import Camera, Gaussians
from ...training import Coverage, Parameters
from .facts import collect_facts
from .page import Pictures, page
from .plots import error_curve
from .sheet import picture_sheet
from .views import (
    PhotoPair,
    best_seen_from,
    measure_feature_agreement,
    orbit_pictures,
    photo_pair,
)

_LOG = logging.getLogger(__name__)

SHEET_FILE = "objects.png"
"""Name of the picture of all objects."""
_COVERAGE_SIDE = 320
"""Longest side of the pictures of training photos in which surfaces are looked for, pixels."""
_MAX_PAIRS = 3
"""Number of test photos that are shown next to their renders."""


def build_report(project: ProjectFolder, *, backend: Backend = "cpu", title: str | None = None) -> list[Path]:
    """Write the report of a project and return the paths of its pages.

    Parameters
    ----------
    project : ProjectFolder
        Held for writing. Stages that are not done are missing in the report too.
    backend : {"cpu", "gpu", "reference"}
        Rasterizer of the pictures.
    title : str, optional
        Of the scene; by default its photos' folder names it.

    Returns
    -------
    list of Path
        ``report/report.html`` in English, then ``report_de.html`` and those of the other languages, each one file with
        all its pictures. ``report.json`` and, where there are objects, ``objects.png`` with four views of each are
        written into the same folder.

    Raises
    ------
    DiskError
        When the report cannot be written.
    HeritageError
        When a part of the project is damaged.
    """
    facts = collect_facts(project, title=title)
    measured = facts["training"].get("curve") or []
    with ThreadPoolExecutor(1) as beside:
        # One core draws the curves while pictures are rendered.
        drawn = {one.code: beside.submit(error_curve, measured, one.translated) for one in languages()}
        pictures = _pictures(project, facts, backend)
        with part("drawing curves"):
            pictures = replace(pictures, curves={code: one.result() for code, one in drawn.items()})
    folder = project.path / "report"
    names = {record["id"]: str(record["name"]) for record in facts["objects"]}
    sheet = picture_sheet([(names[key], sides) for key, sides in pictures.objects.items()])
    if sheet is not None:
        write_png(folder / SHEET_FILE, sheet, description="Every object from four sides")
    else:
        delete_derived(folder, SHEET_FILE)
    write_json(folder / "report.json", finite_or_null(facts))
    pages = {report_file(project.path, language.code): language for language in languages()}
    for path, language in pages.items():
        write_file(path, page(facts, pictures, language))
    return list(pages)


def _pictures(project: ProjectFolder, facts: dict[str, Any], backend: Backend) -> Pictures:
    """Return the pictures of a scene, none of one that is not trained, and measure its features if that is missing."""
    pictures = Pictures()
    if project.stage_record("training") is not None:
        from ...scene import read_camera_set
        from ...training import load_gaussians

        gaussians = load_gaussians(project.path / "gaussians")
        cameras = read_camera_set(project.path / "cameras").by_photo
        training = facts["training"]
        if not training.get("feature_agreement"):
            with part("measurements"):
                training["feature_agreement"] = _feature_agreement(project, cameras, training, gaussians, backend)
        with part("pictures of test photos"):
            held_out = _held_out_pairs(project, cameras, training, gaussians, backend)
        with part("pictures of objects"):
            pictures = Pictures(held_out, _object_pictures(project, cameras, gaussians, backend))
    return pictures


def _held_out_pairs(
    project: ProjectFolder,
    cameras: Mapping[str, Camera],
    training: Mapping[str, Any],
    gaussians: Gaussians,
    backend: Backend,
) -> dict[str, PhotoPair]:
    names = [name for name in training.get("held_out") or training.get("measured_photos") or () if name in cameras]
    # Evenly spaced: consecutive photos look alike.
    picked = [names[i] for i in sorted({round(i) for i in np.linspace(0, len(names) - 1, min(len(names), _MAX_PAIRS))})]
    folder = Path(str(project.get("photo_folder", "")))
    tested = set(training.get("held_out") or ())
    seeing = [
        training_pinhole(camera, max_side=_COVERAGE_SIDE) for name, camera in cameras.items() if name not in tested
    ]
    degree = int(round(gaussians.sh.shape[1] ** 0.5)) - 1
    values = Parameters.from_gaussians(gaussians, sh_degree=degree, features=False).values
    coverage = Coverage(values, seeing, backend=backend)
    pairs = {}
    with ThreadPoolExecutor(_MAX_PAIRS) as threads:
        begun = {
            name: threads.submit(photo_pair(folder, cameras[name], gaussians, coverage, backend=backend))
            for name in picked
        }
        for name, pair in begun.items():
            try:
                pairs[name] = pair.result()
            except (PhotoError, FormatError) as error:
                _LOG.warning("The report shows no picture of %s: %s", name, error)
    return pairs


def _object_pictures(
    project: ProjectFolder,
    cameras: Mapping[str, Camera],
    gaussians: Gaussians,
    backend: Backend,
) -> dict[str, list[Any]]:
    alone: dict[str, Gaussians] = {}
    members: list[NDArray[np.bool_]] = []
    for record in list_objects(project.path):
        try:
            alone[record.id] = object_gaussians(project.path, record, gaussians)
        except ObjectError as error:
            _LOG.warning("The report shows no picture of %s: %s", record.name, error)
            continue
        members.append(load_membership(project.path, record.id) >= record.threshold)
    sides = best_seen_from(Scene(gaussians, backend=backend), members, list(cameras.values()))
    return {
        key: orbit_pictures(one, seen_from, backend=backend)
        for (key, one), seen_from in zip(alone.items(), sides, strict=True)
    }


def _feature_agreement(
    project: ProjectFolder,
    cameras: Mapping[str, Camera],
    training: Mapping[str, Any],
    gaussians: Gaussians,
    backend: Backend,
) -> dict[str, float] | None:
    from ...masks import label_map_path, read_label_map

    files = {
        name: label_map_path(project.path / "masks", name) for name in training.get("held_out") or () if name in cameras
    }
    # One at a time: with segments for all photos there may be hundreds.
    views = ((cameras[name], read_label_map(file)) for name, file in files.items() if file.is_file())
    return measure_feature_agreement(gaussians, views, backend=backend)
