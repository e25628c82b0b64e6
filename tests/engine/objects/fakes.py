"""A SAM and a detector that know the true parts of the blob scene, and a trained project of the scene."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine.core.events import ignore_events, never_stop
from engine.masks.sam import Embedding
from engine.masks.storage import label_map_path, write_label_map
from engine.objects.segmenter import Segmenter
from engine.objects.settings import SegmentSettings
from engine.project.folder import ProjectFolder
from engine.scene.camera_storage import write_camera_set
from engine.training.scene_files import save_gaussians
from tests.engine.pictures.blob_scene import PART_NAMES, BlobScene


@dataclass(frozen=True)
class FakePrediction:
    mask: np.ndarray
    iou: float


class FakeSam:
    """Returns the true parts at points without those at background points, or the part whose box is nearest."""

    def __init__(self, scene: BlobScene) -> None:
        self.scene = scene
        self.name = "fake"
        self.n_encoded = 0
        self.asked: list[tuple[object, ...]] = []

    def encode(self, pixels: np.ndarray) -> Embedding:
        self.n_encoded += 1
        number = next(i for i, photo in enumerate(self.scene.pixels.values()) if np.array_equal(photo, pixels))
        height, width = pixels.shape[:2]
        return Embedding(np.full((1, 256, 64, 64), number, np.float32), height, width, 1024 / max(height, width))

    def predict(self, embedding, points, labels, box) -> FakePrediction:  # type: ignore[no-untyped-def]
        photo = list(self.scene.pixels)[int(embedding.features[0, 0, 0, 0])]
        truth = self.scene.labels[photo]
        self.asked.append((photo, points, labels, box))
        if points is not None and box is None:
            parts = {1.0: set(), 0.0: set()}
            for (x, y), label in zip(points, labels, strict=True):
                parts[float(label)].add(int(truth[int(y), int(x)]))
            mask = np.isin(truth, list(parts[1.0] - parts[0.0]))
        else:
            mask = min((truth == part for part in np.unique(truth)[1:]), key=lambda m: np.abs(box_of(m) - box).sum())
        return FakePrediction(mask, 0.9)


def box_of(mask: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], float)


@dataclass(frozen=True)
class FakeDetection:
    box: np.ndarray
    score: float
    label: str
    region: int | None = None


@dataclass(frozen=True)
class FakeCheck:
    known: bool
    matches: list[tuple[str, float]]
    message: str
    misspelt: bool = False


class FakeDetector:
    """Finds parts by their names in `PART_NAMES`; in `wrong` photos it returns the other parts with higher scores."""

    fingerprint = "fake 1"

    def __init__(self, scene: BlobScene, *, wrong: tuple[str, ...] = ()) -> None:
        self.scene, self.wrong = scene, wrong
        self.name = "fake"

    def check_prompt(self, prompt: str) -> FakeCheck:
        known = prompt in {*PART_NAMES.values(), "ghost"}
        return FakeCheck(known, [("red ball", 0.4), ("blue ball", 0.3)], "" if known else f"{prompt!r} is not known.")

    def detect(self, pixels: np.ndarray, prompt: str, *, labels: np.ndarray | None = None) -> list[FakeDetection]:
        photo = next(name for name, other in self.scene.pixels.items() if np.array_equal(other, pixels))
        found = []
        for part, name in PART_NAMES.items():
            mask = self.scene.labels[photo] == part
            mistaken = photo in self.wrong and name != prompt and prompt != "ghost"
            if mask.sum() > 30 and (name == prompt or mistaken):
                region = None if labels is None else int(np.bincount(labels[mask]).argmax())
                found.append(FakeDetection(box_of(mask), 0.95 if mistaken else 0.8, name, region))
        return found

    def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
        """Return each mask's IoU with each part."""
        photo = next(name for name, other in self.scene.pixels.items() if np.array_equal(other, pixels))
        parts = [self.scene.labels[photo] == part for part in range(1 + max(PART_NAMES))]
        return np.array([[(mask & part).sum() / (mask | part).sum() for part in parts] for mask in masks], np.float32)

    def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
        meant = [part for part, name in PART_NAMES.items() if name == prompt]
        return [float(row[meant].max(initial=0.0)) for row in described]

    def score_unknown(self, described, prompt):  # type: ignore[no-untyped-def]
        return None

    def score_vocabulary(self, described):  # type: ignore[no-untyped-def]
        """Return the same for each of 99 absent words: everything looks somewhat like each of them."""
        return np.full((len(described), 99), 0.5, np.float32)

    def example_vectors(self, described):  # type: ignore[no-untyped-def]
        return described

    def score_examples(self, described, means):  # type: ignore[no-untyped-def]
        """Return the cosine of each description with the mean of each word."""
        lengths = np.linalg.norm(described, axis=1)[:, None] * np.linalg.norm(means, axis=1)
        return described @ means.T / np.maximum(lengths, 1e-6)

    def whole_odds(self, described):  # type: ignore[no-untyped-def]
        return np.zeros(len(described), np.float32)

    def fitting_word(self, described, prompt):  # type: ignore[no-untyped-def]
        return ""

    def name_descriptions(self, described):  # type: ignore[no-untyped-def]
        """Return the name of the part that the descriptions fit best, with their mean IoU as the score."""
        if len(described) == 0:
            return []
        mean = np.mean(described, axis=0)
        return [(PART_NAMES.get(int(mean.argmax()), "floor"), float(mean.max()))]


def trained_project(scene: BlobScene, folder: Path, *, features: bool = True, segments: bool = True) -> ProjectFolder:
    """Write a project as if `scene` had been trained, and its photos beside the project.

    With `segments`, the true parts are the segments of the photos.
    """
    photos = scene.write_photos(folder / "photos")
    project = ProjectFolder.create(folder / "project")
    project.put("photo_folder", str(photos))
    gaussians = scene.gaussians
    if not features:
        from dataclasses import replace

        gaussians = replace(gaussians, features=None)
    save_gaussians(project.path / "gaussians", gaussians)
    write_camera_set(project.path / "cameras", scene.cameras)
    for photo, labels in scene.labels.items() if segments else ():
        write_label_map(label_map_path(project.path / "masks", photo), labels)
    return project


def copied_project(source: Path, folder: Path) -> ProjectFolder:
    """Copy what `trained_project` wrote into the folder `source`, photos included."""
    shutil.copytree(source, folder, dirs_exist_ok=True)
    project = ProjectFolder.open_existing(folder / "project")
    project.put("photo_folder", str(folder / "photos"))
    return project


def segmenter_of(project: ProjectFolder, scene: BlobScene, settings: SegmentSettings, **given: Any) -> Segmenter:
    """Return a segmenter with the fakes of a scene, or the models and functions that are `given`."""
    usual = {
        "detector_factory": lambda: FakeDetector(scene),
        "sam_factory": lambda: FakeSam(scene),
        "emit": ignore_events,
        "should_stop": never_stop,
    }
    return Segmenter(project, settings, **{**usual, **given})
