"""A prompt becomes objects: seeds in photos, lifted to the Gaussians, told apart, refined, completed and stored."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import CameraSet
from ..errors import Cancelled, FormatError, PromptError
from ..events import Emit, Progress, StopCheck
from ..gaussians.gaussians import Gaussians
from ..pictures.scene import Backend, Scene
from ..project_folder import ProjectFolder
from ..settings import to_dict
from .lifting import Lifted, complete, lift, refine_by_votes
from .prompts import Prompt, TextPrompt, describe_prompt
from .seeds import DetectorFactory, SamFactory, Seed, find_seeds
from .settings import SegmentSettings
from .storage import ObjectRecord, list_objects, new_id, new_name, save_object
from .views import View, Views

__all__ = ["THRESHOLD", "FoundObject", "find_objects", "segment_project"]

THRESHOLD = 0.5
"""Membership from which on a Gaussian belongs to an object, until the person moves the slider."""

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


@dataclass
class _Group:
    """Seeds that turned out to show one object."""

    best: Lifted
    seeds: list[Seed]
    fit: float


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
    seeds = find_seeds(
        prompt,
        views,
        photo_folder,
        label_maps,
        settings,
        detector_factory=detector_factory,
        sam_factory=sam_factory,
        emit=emit,
        should_stop=should_stop,
    )
    groups = _group(views, seeds, settings, should_stop)
    if not groups:
        raise PromptError(
            "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
        )
    scored = _scored(views, groups, isinstance(prompt, TextPrompt), settings)
    found: list[FoundObject] = []
    for number, (score, group) in enumerate(scored):
        membership = _finished(views, group, label_maps, settings, should_stop)
        if not any(_overlap(membership, other.membership) > settings.same_object for other in found):
            best = group.seeds[0]
            fit = _fit(views, best.view, best.mask, membership)
            found.append(FoundObject(membership, score, fit, tuple(group.seeds)))
        emit(Progress("objects", 0.7 + 0.3 * (number + 1) / len(scored), message="Isolating"))
    return found


def _fit(views: Views, view: View, mask: NDArray[np.bool_], membership: Float32) -> float:
    """Return the IoU of a mask with the object rendered in the same view."""
    shown = views.visible_share(view, membership >= THRESHOLD) > 0.5
    union = int((shown | mask).sum())
    return int((shown & mask).sum()) / union if union else 0.0


def _overlap(one: Float32, other: Float32) -> float:
    """Return the common Gaussians as a part of the smaller object's."""
    a, b = one >= THRESHOLD, other >= THRESHOLD
    smaller = min(int(a.sum()), int(b.sum()))
    return int((a & b).sum()) / smaller if smaller else 0.0


def _group(views: Views, seeds: Sequence[Seed], settings: SegmentSettings, should_stop: StopCheck) -> list[_Group]:
    """Lift every seed and put those that show the same Gaussians together, led by the one that fits its mask best."""
    groups: list[_Group] = []
    for seed in sorted(seeds, key=lambda seed: -seed.score):
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        wanted = settings if seed.whole else replace(settings, parts=1)
        lifted = lift(views, seed.view, seed.mask, wanted, start=seed.start)
        if lifted is None:
            continue
        fit = _fit(views, seed.view, seed.mask, lifted.membership)
        same = next((g for g in groups if _overlap(g.best.membership, lifted.membership) > settings.same_object), None)
        if same is None:
            groups.append(_Group(lifted, [seed], fit))
        elif seed.score * fit > same.seeds[0].score * same.fit:
            same.best, same.fit = lifted, fit
            same.seeds.insert(0, seed)
        else:
            same.seeds.append(seed)
    return groups


def _scored(
    views: Views, groups: Sequence[_Group], by_text: bool, settings: SegmentSettings
) -> list[tuple[float, _Group]]:
    """Return the groups worth keeping with their score, the best first.

    For a text the score is the detector's, averaged over the views it looked at that face the object (0 where it
    found something else), times how well the Gaussians found fill the best mask. A find that several views agree on
    thus wins over a louder one of a single view.
    """
    if not by_text:
        return [(group.seeds[0].score, group) for group in groups]
    looked_at = {seed.view.camera.photo for group in groups for seed in group.seeds}
    scored = []
    for group in groups:
        center = np.median(views.scene.gaussians.means[group.best.members], axis=0)
        facing = [camera.photo for camera in views.facing(center) if camera.photo in looked_at]
        by_photo: dict[str, float] = {}
        for seed in group.seeds:
            photo = seed.view.camera.photo
            by_photo[photo] = max(by_photo.get(photo, 0.0), seed.score)
        score = sum(by_photo.values()) / max(len(facing), len(by_photo)) * group.fit
        scored.append((min(1.0, score), group))
    scored.sort(key=lambda pair: -pair[0])
    best = scored[0][0]
    return [pair for pair in scored if pair[0] >= settings.relative_score * best][: settings.max_objects]


def _finished(
    views: Views,
    group: _Group,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Float32:
    lifted, seen = group.best, None
    if settings.refinement == "votes":
        best = group.seeds[0]
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
        _photo_folder(project),
        prompt,
        settings,
        label_maps=_label_maps(project.path, cameras),
        detector_factory=detector_factory,
        sam_factory=sam_factory,
        emit=emit,
        should_stop=should_stop,
        backend=backend,
    )
    taken = list_objects(project.path)
    records: list[ObjectRecord] = []
    seconds = round(time.perf_counter() - started, 3)
    for item in found:
        everyone = [*taken, *records]
        record = ObjectRecord(
            id=new_id(name, [other.id for other in everyone]),
            name=new_name(name, [other.name for other in everyone]),
            prompt=dict(describe_prompt(prompt)),
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


def _photo_folder(project: ProjectFolder) -> Path:
    folder = project.get("photo_folder")
    if not isinstance(folder, str):
        raise FormatError(f"{project.path / 'project.json'} does not say where the photos are. Reconstruct again.")
    return Path(folder)


def _label_maps(project: Path, cameras: CameraSet) -> dict[str, NDArray[np.int32]]:
    """Return the SAM label maps that were made for training, by photo."""
    from ..masks.storage import label_map_path, read_label_map

    files = {camera.photo: label_map_path(project / "masks", camera.photo) for camera in cameras.cameras}
    return {photo: read_label_map(file) for photo, file in files.items() if file.is_file()}
