"""A prompt becomes objects: seeds in photos, lifted to the Gaussians, told apart, refined, completed and stored."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import CameraSet
from ..errors import FormatError, PromptError
from ..events import Emit, Progress, StopCheck
from ..gaussians.gaussians import Gaussians
from ..pictures.scene import Backend, Scene
from ..project_folder import ProjectFolder
from ..settings import to_dict
from .candidates import THRESHOLD, Candidate, fit_of, gather, overlap, rank_for_text
from .lifting import complete, refine_by_votes
from .prompts import Prompt, TextPrompt, describe_prompt
from .seeds import DetectorFactory, Photos, SamFactory, Seed, find_seeds
from .settings import SegmentSettings
from .storage import ObjectRecord, list_objects, new_id, new_name, save_object
from .views import Views

__all__ = ["THRESHOLD", "FoundObject", "find_objects", "label_maps_of", "photo_folder_of", "segment_project"]

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class FoundObject:
    """An object before it has a name.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1]; `THRESHOLD` and above belongs.
    score : float
        See `ObjectRecord.score`.
    fit : float
        Intersection over union with the best seed mask in its view.
    seeds : tuple of Seed
        Masks that show it, the best first.
    """

    membership: Float32
    score: float
    fit: float
    seeds: tuple[Seed, ...]


def find_objects(
    gaussians: Gaussians,
    cameras: CameraSet,
    photo_folder: Path,
    prompt: Prompt,
    settings: SegmentSettings,
    *,
    label_maps: Mapping[str, NDArray[np.int32]],
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    backend: Backend = "cpu",
) -> list[FoundObject]:
    """Return the objects of a scene that `prompt` asks for, the best first; at least one.

    Parameters
    ----------
    gaussians : Gaussians
        With features.
    cameras : CameraSet
    photo_folder : Path
    prompt : Prompt
    settings : SegmentSettings
    label_maps : mapping of str to int32 array of shape [h, w]
        SAM label maps by photo, for a text and for the votes; may be empty.
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.
    backend : {"cpu", "reference"}

    Returns
    -------
    list of FoundObject

    Raises
    ------
    PromptError
        When nothing was found.
    ObjectError
        When the scene has no features.
    Cancelled
        When `should_stop` says so.

    References
    ----------
    Dahaghin et al., "Gaussian Heritage" (2024): feature of the best-fitting mask over sampled views, cosine 0.7,
    convex hull.
    """
    views = Views(Scene(gaussians, backend=backend), cameras, render_side=settings.render_side)
    photos = Photos(photo_folder, settings.photo_side, sam_factory)
    seeds = find_seeds(
        prompt,
        views,
        photos,
        label_maps,
        settings,
        detector_factory=detector_factory,
        emit=emit,
        should_stop=should_stop,
    )
    candidates = gather(views, seeds, settings, should_stop)
    if not candidates:
        raise PromptError(
            "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
        )
    if isinstance(prompt, TextPrompt):
        scored = rank_for_text(prompt.text, candidates, views, photos, detector_factory(), settings, should_stop)
    else:
        scored = [(candidate.seeds[0].score, candidate) for candidate in candidates]
    found: list[FoundObject] = []
    for number, (score, candidate) in enumerate(scored):
        membership = _finished(views, candidate, label_maps, settings, should_stop)
        if not any(overlap(membership, other.membership) > settings.same_object for other in found):
            best = candidate.seeds[0]
            fit = fit_of(views, best.view, best.mask, membership)
            found.append(FoundObject(membership, score, fit, tuple(candidate.seeds)))
        emit(Progress("objects", 0.7 + 0.3 * (number + 1) / len(scored), message="Isolating"))
    return found


def _finished(
    views: Views,
    candidate: Candidate,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Float32:
    lifted, seen = candidate.best, None
    if settings.refinement == "votes":
        best = candidate.seeds[0]
        seed = (best.view, best.mask) if best.given else None
        lifted, seen = refine_by_votes(views, lifted, seed, label_maps, settings, should_stop=should_stop)
    return complete(views, lifted, settings, seen)


def segment_project(
    project: ProjectFolder,
    prompt: Prompt,
    name: str,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    backend: Backend = "cpu",
) -> list[ObjectRecord]:
    """Isolate what `prompt` asks for in a trained project and store each match as an object of its own.

    Parameters
    ----------
    project : ProjectFolder
        Trained, and held for writing.
    prompt : Prompt
    name : str
        Of the objects; further matches get ``-2``, ``-3``...
    settings : SegmentSettings
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.
    backend : {"cpu", "reference"}

    Returns
    -------
    list of ObjectRecord
        Those stored now, the best first.

    Raises
    ------
    PromptError
        When nothing was found.
    HeritageError
        When a part of the project is missing or damaged.
    """
    from ..cameras.storage import read_camera_set
    from ..gaussians.storage import load_gaussians

    started = time.perf_counter()
    cameras = read_camera_set(project.path / "cameras")
    found = find_objects(
        load_gaussians(project.path / "gaussians"),
        cameras,
        photo_folder_of(project),
        prompt,
        settings,
        label_maps=label_maps_of(project.path, cameras),
        detector_factory=detector_factory,
        sam_factory=sam_factory,
        emit=emit,
        should_stop=should_stop,
        backend=backend,
    )
    taken = list_objects(project.path)
    asked: dict[str, str | float] = dict(describe_prompt(prompt))
    if isinstance(prompt, TextPrompt):
        asked["detector"] = detector_factory().name
    records: list[ObjectRecord] = []
    seconds = round(time.perf_counter() - started, 3)
    for item in found:
        everyone = [*taken, *records]
        record = ObjectRecord(
            id=new_id(name, [other.id for other in everyone]),
            name=new_name(name, [other.name for other in everyone]),
            prompt=asked,
            threshold=THRESHOLD,
            score=round(item.score, 4),
            fit=round(item.fit, 4),
            n_gaussians=int((item.membership >= THRESHOLD).sum()),
            n_scene_gaussians=len(item.membership),
            seeds=tuple({"photo": seed.view.camera.photo, "score": round(seed.score, 4)} for seed in item.seeds),
            settings=to_dict(settings),
            seconds=seconds,
            created=datetime.now(UTC).isoformat(timespec="microseconds"),
        )
        best = item.seeds[0]
        preview = np.where(best.view.to_photo(best.mask), np.uint8(255), np.uint8(0))
        save_object(project.path, record, item.membership, [("seed", preview)])
        records.append(record)
    return records


def photo_folder_of(project: ProjectFolder) -> Path:
    """Return where the photos of a project are.

    Raises
    ------
    FormatError
        When the project does not say.
    """
    folder = project.get("photo_folder")
    if not isinstance(folder, str):
        raise FormatError(f"{project.path / 'project.json'} does not say where the photos are. Reconstruct again.")
    return Path(folder)


def label_maps_of(project: Path, cameras: CameraSet) -> dict[str, NDArray[np.int32]]:
    """Return the SAM label maps that were made for training, by photo."""
    from ..masks.storage import label_map_path, read_label_map

    files = {camera.photo: label_map_path(project / "masks", camera.photo) for camera in cameras.cameras}
    return {photo: read_label_map(file) for photo, file in files.items() if file.is_file()}
