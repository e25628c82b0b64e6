"""Fit how whole segments look to SAM: ``python -m benchmarks.rooms.whole_segments ROOM ...``.

Each ROOM has a trained ``project`` and its ``truth``; what is measured of it is kept there in ``whole_segments.npz``.
The command writes the weights that `engine.masks.wholeness` reads, and prints how well they do in rooms left out. The
weights of `benchmarks.rooms.wholeness` are fitted to proposals that these weights chose, so fit those after these.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.sparse import csr_matrix

from engine.errors import HeritageError
from engine.files import ArraySpec, keep_arrays, read_kept_arrays
from engine.masks import EmbeddingFolder, load_default_sam
from engine.masks.wholeness import WEIGHTS_FILE, features_of_segments
from engine.objects import SegmentationContext, load_context, proposals
from engine.objects.settings import BETTER
from engine.project_folder import ProjectFolder, stage_key

from .wholeness import Measured, fit, log_loss, things_of, write_weights

_SPECS = {
    "odds": ArraySpec("float32", ("k",), finite=True),
    "features": ArraySpec("float32", ("k", 256), finite=True),
    "iou": ArraySpec("float32", ("k",), finite=True),
}


def measure(room: Path) -> Measured:
    """Return what `fit` needs of a room, measured once."""
    context = load_context(ProjectFolder.open_existing(room / "project"), BETTER, _no_detector, load_default_sam)
    file, recipe = room / "whole_segments.npz", stage_key("whole segments 1", context.graph.key)
    arrays = read_kept_arrays(file, recipe, _SPECS)
    if arrays is None:
        # All sets, by what is measured of them alone.
        with mock.patch.object(proposals, "LEAST_PROBABILITY", np.finfo(np.float64).tiny):
            found = proposals.find_proposals(replace(context, segment_odds={}))
        members, things = (csr_matrix(one, dtype=np.float32) for one in (found.members, things_of(context, room)))
        iou = context.graph.iou(members, things).max(axis=1)
        features = found.fit @ _features(context, room)
        arrays = {"odds": found.odds, "features": features, "iou": iou}
        arrays = {name: np.asarray(value, np.float32) for name, value in arrays.items()}
        keep_arrays(file, recipe, arrays)
    return Measured(arrays["odds"], arrays["features"], arrays["iou"])


def _features(context: SegmentationContext, room: Path) -> np.ndarray:
    """Return SAM's mean features in each segment of the graph, [M, 256], 0 for the rest of a photo."""
    graph, stored, sam = context.graph, EmbeddingFolder(room / "project" / "masks"), load_default_sam()
    rows = np.zeros((len(graph.ids), 256), np.float32)
    for number, photo in enumerate(graph.photos):
        pixels = context.photos.pixels(context.views.cameras.by_photo[photo])
        found = features_of_segments(stored.encode(photo, pixels, sam), context.label_maps[photo])
        segments = np.flatnonzero((graph.photo == number) & graph.is_segment)
        rows[segments] = found[graph.ids[segments] - 1]
    return rows


def _no_detector() -> None:
    raise AssertionError("Proposals need no detector.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the rooms, fit, and write the weights."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rooms.whole_segments", description=__doc__)
    parser.add_argument("rooms", nargs="+", type=Path, metavar="ROOM", help="folder with project and truth")
    parser.add_argument("--out", type=Path, default=WEIGHTS_FILE, help="file of the weights (default: %(default)s)")
    options = parser.parse_args(arguments)
    try:
        measured = [measure(room) for room in options.rooms]
    except HeritageError as error:
        parser.error(str(error))
    left_out = [fit(measured[:k] + measured[k + 1 :]) for k in range(len(measured))] if len(measured) > 1 else []
    losses = [log_loss(room, *fitted) for room, fitted in zip(measured, left_out, strict=False)]
    if losses:
        print(f"log-loss of the IoU in rooms left out: {np.mean(losses):.3f}")
    write_weights(options.out, *fit(measured), f"{len(measured)} rooms, see benchmarks/rooms/whole_segments.py")
    print("Label maps have odds of the former weights: raise _METHOD_VERSION in engine/masks/stage.py.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
