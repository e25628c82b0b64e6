"""The contents of a project, as the API describes it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

from ..core.errors import HeritageError
from ..core.files import bytes_of, object_file, path_within
from ..delivery.records import describe_unit
from ..project.content import ProjectObject, is_project, shown_objects
from ..project.folder import ProjectFolder
from ..project.objects import RECORD_FILE, load_record, state_of
from ..project.own_words import read_learning
from ..project.refused_prompts import read_not_found
from .job_queue import JobQueue, JobView
from .library import WebProject
from .settings import ServeSettings
from .trash import TrashItem
from .videos import describe_videos
from .word_models import describe_offer

_UNREGISTERED_SENTENCE = "No camera position was found for it."
_REFUTED_SENTENCE = "The other photos refute its camera position."
"""Why a photo is not used, where the check of the photos itself has no reason."""


def summarise_project(queue: JobQueue, project: WebProject) -> dict[str, Any]:
    """Return what a list of projects shows."""
    n_photos = len(project.photo_names())
    return {
        "id": project.id,
        "title": project.title,
        "created": project.created,
        "n_photos": n_photos,
        "cover": _cover(project),
        "state": "damaged" if project.is_damaged else _state(queue, project, n_photos),
    }


def _cover(project: WebProject) -> str:
    """Return the name of the photo that stands for the project; empty without photos."""
    return next(iter(project.photo_names()), "")


def describe_project(queue: JobQueue, project: WebProject, settings: ServeSettings) -> dict[str, Any]:
    """Return everything that the page of a project shows."""
    not_found = read_not_found(project.project) if has_scene(project) else None
    return {
        **summarise_project(queue, project),
        "photos": _photos(project),
        "videos": describe_videos(project),
        "removed": [describe_removed(item) for item in project.trash.items()],
        "job": _as_dict(queue.last(project.folder)),
        "waiting": [_as_dict(view) for view in queue.waiting(project.folder)],
        "scene": _scene(project),
        "objects": [describe_object(project, one) for one in _objects(project)],
        "learns": _learns(project),
        "not_found": None if not_found is None else {
            "messages": [refusal.message for refusal in not_found.refusals],
            "suggestions": list(dict.fromkeys(one for refusal in not_found.refusals for one in refusal.suggestions)),
            "objects": list(dict.fromkeys(one for refusal in not_found.refusals for one in refusal.object_ids)),
            "offer": describe_offer(not_found.offer, settings),
            "candidates": [
                {
                    "number": one.number, "text": one.text, "score": one.score, "photo": one.photo,
                    "object": one.object_id,
                    "picture": f"/api/v1/projects/{project.id}/candidates/{one.number}.png",
                }
                for one in not_found.candidates
            ],
        },
    }  # fmt: skip


def describe_object(project: WebProject, item: ProjectObject) -> dict[str, Any]:
    """Return an object with the record that a curator has entered, and the state that tells when it has changed."""
    record = asdict(load_record(project.project, item.id))
    names = ("id", "name", "prompt", "score", "kind", "n_gaussians", "has_detail")
    shown = {name: getattr(item, name) for name in names}
    picture = f"/api/v1/projects/{project.id}/objects/{item.id}/thumbnail.jpg"
    state = state_of(object_file(project.project, item.id, RECORD_FILE).parent)
    return {**shown, **record, "picture": picture, "state": state}


def describe_removed(item: TrashItem) -> dict[str, Any]:
    """Return what the trash shows of a photo, a video or a project."""
    return {"id": item.id, "name": item.name, "bytes": item.n_bytes}


def has_scene(project: WebProject) -> bool:
    """Return whether the scene of a project is trained."""
    return path_within(project.project, "gaussians", "scene.ply").is_file()


def _objects(project: WebProject) -> list[ProjectObject]:
    return shown_objects(project.project) if has_scene(project) else []


def _state(queue: JobQueue, project: WebProject, n_photos: int) -> str:
    if queue.waiting(project.folder):
        return "waiting"
    job = queue.last(project.folder)
    if job is not None and job.state == "running":
        return "working"
    if has_scene(project):
        return "ready"
    if job is not None and job.state == "stopped":
        return "stopped"
    return "uploaded" if n_photos else "empty"


def _photos(project: WebProject) -> list[dict[str, Any]]:
    """Return the photos; those that the engine has looked at with its verdict."""
    rejected: dict[str, str] = {}
    used: set[str] = set()
    record = _stage(project, "photos")
    if record is not None:
        figures = record.get("figures") or {}
        rejected = {str(one.get("name")): str(one.get("reason")) for one in figures.get("rejected", ())}
        cameras = _stage(project, "cameras")
        if cameras is not None:
            without = [str(name) for name in (cameras.get("figures") or {}).get("unregistered", ())]
            rejected.update(dict.fromkeys(without, _UNREGISTERED_SENTENCE))
            refuted = _health(cameras).get("refuted", ())
            rejected.update(dict.fromkeys(map(str, refuted), _REFUTED_SENTENCE))
        used = set(project.photo_names()) - set(rejected)
    names = project.photo_names()
    sizes = {name: bytes_of(project.photos / name) for name in names}
    return [
        {
            "name": name,
            "bytes": sizes[name],
            "accepted": False if name in rejected else True if name in used else None,
            "reason": rejected.get(name, ""),
        }
        for name in names
    ]


def _scene(project: WebProject) -> dict[str, Any] | None:
    record = _stage(project, "training")
    if record is None or not has_scene(project):
        return None
    figures = record.get("figures") or {}
    health = _health(_stage(project, "cameras") or {})
    return {
        "n_gaussians": figures.get("n_gaussians"),
        "psnr": figures.get("psnr"),
        "cameras": "" if health.get("colour") in (None, "green") else str(health.get("sentence", "")),
        "state": _state_of_scene(project),
    }


def _state_of_scene(project: WebProject) -> str:
    """Return what differs when the viewer has to load the scene or its cameras again."""
    folder = ProjectFolder.open_existing(project.project)
    outputs = [sorted(map(str, folder.recorded_outputs(stage).items())) for stage in ("cameras", "training")]
    return hashlib.sha256(json.dumps([outputs, describe_unit(folder)]).encode()).hexdigest()


def _health(cameras: dict[str, Any]) -> dict[str, Any]:
    """Return the finding of the check of the cameras; empty where nothing was checked."""
    found = (cameras.get("figures") or {}).get("health")
    return found if isinstance(found, dict) else {}


def _stage(project: WebProject, name: str) -> dict[str, Any] | None:
    if not is_project(project.project):
        return None
    try:
        return ProjectFolder.open_existing(project.project).stage_record(name)
    except HeritageError:
        return None  # what is wrong with it is said by the next job


def _learns(project: WebProject) -> bool:
    try:
        return read_learning(project.project)
    except HeritageError:
        return False  # what is wrong with it is said by the next job


def _as_dict(view: JobView | None) -> dict[str, Any] | None:
    return None if view is None else dict(vars(view))
