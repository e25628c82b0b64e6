"""Clicks on a scene that is known exactly hit the ball that is seen; wrong labels count as misses."""

from __future__ import annotations

import numpy as np

from benchmarks.viewport_clicks import click_objects
from engine.quality.evaluation import GroundTruth
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene, make_scene

NAMES = {RED: "red", TWIN: "twin", BLUE: "blue"}


def truth_of(blobs: BlobScene) -> GroundTruth:
    objects = tuple(sorted(NAMES.values()))
    readers = {
        photo: lambda labels=labels: {name: labels == part for part, name in NAMES.items()}
        for photo, labels in blobs.labels.items()
    }
    return GroundTruth("museum", tuple(readers), objects, {name: name for name in objects}, (), True, readers)


def test_clicks_hit_what_is_seen_in_at_least_95_of_100() -> None:
    blobs = make_scene()
    truth = truth_of(blobs)
    labels = np.full(len(blobs.part), -1)
    for part, name in NAMES.items():
        labels[blobs.part == part] = truth.objects.index(name)
    cameras = blobs.cameras.cameras
    assert click_objects(blobs.gaussians, labels, cameras, truth, n=100, seed=0).hits >= 95
    assert click_objects(blobs.gaussians, labels, cameras, truth, n=100, seed=0, beside=True).hits >= 95
    shuffled = np.random.default_rng(0).permutation(labels)
    assert click_objects(blobs.gaussians, shuffled, cameras, truth, n=100, seed=0).hits < 60
