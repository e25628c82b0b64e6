"""Facts about an object or a scene and how it was made, as JSON values: the source of every other record.

Nothing is measured here. What a project does not say is left out or None, never guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from ...core.errors import FormatError
from ...core.files import Schema, check, object_file, optional, path_within
from ...install.models.catalogue import CATALOGUE, MODELS
from ...project.folder import PROJECT_FILE, SCENE_OUTPUT, ProjectFolder
from ...project.objects import RECORD_FILE, ObjectRecord, load_record, read_record, recorded_files
from ...project.provenance import describe_run
from ...scene import read_camera_set, read_photo_set
from .unit import describe_unit

PARADATA_VERSION = 1
_STEPS = {
    "photos": "reading the photos",
    "cameras": "estimating the cameras",
    "masks": "segmenting the photos",
    "training": "training the Gaussians",
    "objects": "isolating objects",
}
_INPUTS = {
    "photos": (),
    "cameras": ("photos",),
    "masks": ("photos", "cameras"),
    "training": ("photos", "cameras", "masks"),
    "objects": ("photos", "cameras", "masks", "training"),
}
"""Stages whose outputs a stage reads. The photos themselves are inputs of all."""
_METRICS = (
    "psnr", "ssim", "l1", "fitted_psnr", "well_seen_psnr", "well_seen_share", "dark_share", "steps", "n_gaussians",
    "sh_degree", "n_registered", "reprojection_error", "n_points", "n_photos", "poses_given", "device", "preset",
    "feature_agreement",
)  # fmt: skip
"""Figures of stages that a record repeats."""
_GENERIC = ("", "project", "photos", "images", "pictures", "fotos", "dcim")
_FIGURES: Schema = {
    "rejected": optional([{"name": str, "reason": str}]),
    "unregistered": optional([str]),
    "held_out": optional(([str], None)),
    "refused": optional({str: str}),
}


def scene_title(project: ProjectFolder) -> str:
    """Return the name of the photo folder, or of the folders around it where that name is generic."""
    photos = PurePath(str(project.get("photo_folder") or ""))
    folder = project.path.resolve()
    for name in (photos.name, photos.parent.name, folder.name, folder.parent.name):
        if name.lower() not in _GENERIC:
            return name
    return folder.name or "scene"


def describe_scene(project: ProjectFolder, *, title: str | None = None) -> dict[str, Any]:
    """Return the record of the whole scene.

    Parameters
    ----------
    title : str, optional
        Title of the scene instead of `scene_title`.

    Returns
    -------
    dict
        JSON values: ``version``, ``kind`` ("scene"), ``title``, ``identifier`` (SHA-256 of the Gaussians), ``unit``,
        ``captures`` (a photo each: name, size, SHA-256, use), ``rejected_photos``, ``steps`` (what ran: time, software,
        commit, parameters, seed, inputs and outputs with SHA-256, results), ``models`` and ``exported`` (what writes
        this record).

    Raises
    ------
    FormatError
        When a part of the project that is read is damaged.
    """
    figures = _figures(project)
    cameras = set(_placed_photos(project))
    captures, rejected = _captures(project, figures, cameras)
    rejected += [
        {"name": name, "reason": "No camera position was found for it."}
        for name in figures["cameras"].get("unregistered", ())
        if name not in {photo["name"] for photo in rejected}
    ]
    scene = project.recorded_outputs("training").get(SCENE_OUTPUT)
    return {
        "version": PARADATA_VERSION,
        "kind": "scene",
        "title": title or scene_title(project),
        "identifier": None if scene is None else f"sha256:{scene['sha256']}",
        "unit": describe_unit(project),
        "captures": captures,
        "rejected_photos": rejected,
        "steps": [_step(project, stage, figures, captures) for stage in _STEPS if project.stage_record(stage)],
        "models": _models(project),
        "exported": describe_run(),
    }


def describe_object(project: ProjectFolder, object_id: str, *, title: str | None = None) -> dict[str, Any]:
    """Return the record of an object: that of its scene, called `title`, with ``kind`` "object" and ``object``.

    ``object`` has the museum's fields (``catalogue_number``, ``title``, ``rights``, ``notes``), ``prompt``,
    ``threshold``, ``confidence``, ``agreement``, the photos of its evidence, and ``hand_edits``, which counts what a
    person corrected. ``title`` is the museum's whole title, or the name of the object.

    Raises
    ------
    FormatError
        When a part of the project that is read is damaged.
    """
    described = describe_scene(project, title=title)
    file = object_file(project.path, object_id, RECORD_FILE)
    record, museum = read_record(file), load_record(project.path, object_id)
    files = recorded_files(file)
    membership = files.get("membership.npy")
    scene = described["title"]
    described |= {
        "kind": "object",
        "title": museum.title or record.name,
        "scene_title": scene,
        "identifier": None if membership is None else f"sha256:{membership['sha256']}",
        "object": {
            "id": record.id,
            "name": record.name,
            **museum.as_dict(),
            "prompt": record.prompt,
            "threshold": record.threshold,
            "confidence": record.score,
            "agreement": record.fit,
            "n_gaussians": record.n_gaussians,
            "n_scene_gaussians": record.n_scene_gaussians,
            "evidence": [dict(one) for one in record.evidence],
            "hand_edits": _hand_edits(record),
        },
    }
    described["steps"] = [step for step in described["steps"] if step["stage"] != "objects"]
    described["steps"].append(_object_step(record, files, described["steps"]))
    return described


def _hand_edits(record: ObjectRecord) -> dict[str, int]:
    """Count what a person changed: corrections, their clicks on the object and outside of it."""
    clicks = [len(one.get("clicks", ())) for one in record.refined]
    others = [len(one.get("not", ())) for one in record.refined]
    return {"corrections": len(record.refined), "clicks_on": sum(clicks), "clicks_beside": sum(others)}


def _object_step(
    record: ObjectRecord, files: Mapping[str, Mapping[str, Any]], steps: list[dict[str, Any]]
) -> dict[str, Any]:
    run = record.run or {}
    training = next((step for step in steps if step["stage"] == "training"), None)
    return {
        "stage": "objects",
        "what": _STEPS["objects"],
        "finished": run.get("finished") or record.created or None,
        **{name: run.get(name) for name in ("software", "commit", "changed", "machine")},
        "settings": record.settings,
        "seed": None,
        "wall_seconds": record.seconds,
        "cpu_seconds": None,
        "inputs": [] if training is None else training["outputs"],
        "outputs": [{"name": f"objects/{record.id}/{name}", **one} for name, one in sorted(files.items())],
        "results": {"confidence": record.score, "agreement": record.fit, "n_gaussians": record.n_gaussians},
    }


def _step(
    project: ProjectFolder, stage: str, figures: Mapping[str, dict[str, Any]], captures: list[dict[str, Any]]
) -> dict[str, Any]:
    stored = project.stage_record(stage) or {}
    run = stored.get("run") or {}
    photos = [{"name": one["name"], "sha256": one["sha256"]} for one in captures]
    inputs = photos + [one for earlier in _INPUTS[stage] for one in _outputs(project, earlier)]
    return {
        "stage": stage,
        "what": _STEPS[stage],
        **{name: run.get(name) for name in ("finished", "software", "commit", "changed", "machine")},
        **{name: run.get(name) for name in ("settings", "seed")},
        **{name: stored.get(name) for name in ("wall_seconds", "cpu_seconds")},
        "inputs": inputs,
        "outputs": _outputs(project, stage),
        "results": {name: figures[stage][name] for name in _METRICS if name in figures[stage]},
    }


def _outputs(project: ProjectFolder, stage: str) -> list[dict[str, Any]]:
    return [{"name": name, **record} for name, record in project.recorded_outputs(stage).items()]


def _placed_photos(project: ProjectFolder) -> list[str]:
    """Return the names of the photos that have a camera."""
    folder = path_within(project.path, "cameras")
    return [camera.photo for camera in read_camera_set(folder).cameras] if folder.is_dir() else []


def _captures(
    project: ProjectFolder, figures: Mapping[str, dict[str, Any]], cameras: set[str]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return what is known of each photo that was read, and of those that were not used."""
    file = path_within(project.path, "photos", "photos.json")
    if not file.exists():
        return [], []
    photo_set = read_photo_set(file)
    held_out = set(figures["training"].get("held_out") or ())
    captures = [
        {
            "name": photo.name,
            "width": photo.width,
            "height": photo.height,
            "sha256": photo.sha256,
            "use": "not used" if photo.name not in cameras else "test" if photo.name in held_out else "training",
        }
        for photo in photo_set.photos
    ]
    return captures, [{"name": one.name, "reason": one.reason} for one in photo_set.rejected]


def _models(project: ProjectFolder) -> list[dict[str, Any]]:
    """Return the weight files of the steps, as far as the project names them."""
    run = (project.stage_record("masks") or {}).get("run") or {}
    name = (run.get("settings") or {}).get("model")
    if not isinstance(name, str):
        return []
    files = MODELS[name].files if name in MODELS else ()
    models = [CATALOGUE[file] for file in files if file in CATALOGUE]
    return [
        {"name": model.name, "source": model.source, "sha256": model.sha256, "licence": model.licence}
        for model in models
    ]


def _figures(project: ProjectFolder) -> dict[str, dict[str, Any]]:
    """Return the figures of each stage, whose parts that a record repeats are checked."""
    figures = {stage: dict((project.stage_record(stage) or {}).get("figures") or {}) for stage in _STEPS}
    for stage, values in figures.items():
        problem = check(values, _FIGURES, f"stages.{stage}.figures")
        if problem:
            raise FormatError(
                f"{project.path / PROJECT_FILE} cannot be read: {problem}. Run `reconstruct` in a new folder, or ask "
                "whoever made the project for an undamaged copy."
            )
    return figures
