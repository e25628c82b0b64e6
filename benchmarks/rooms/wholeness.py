"""Fit how whole things look: ``python -m benchmarks.rooms.wholeness ROOM ...``.

Each ROOM has a trained ``project`` and its ``truth``; what is measured of it is kept there in ``wholeness.npz``. The
command writes the weights that `engine.objects.grounding.wholeness` reads, and prints how well they do in rooms left
out. Rooms with our own exhibits count as much together as those with 3D models of other people. With ``--near FILE``,
the weights stay near to those of a file, which were fitted to rooms that are not at hand.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse import csr_matrix
from scipy.special import expit

from engine.core.errors import HeritageError
from engine.core.events import never_stop
from engine.core.files import ArraySpec, atomic_write, keep_arrays, optional, read_json, read_kept_arrays
from engine.objects import load_context
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.wholeness import WEIGHTS_FILE
from engine.objects.looks import build_looks
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder, stage_key
from engine.quality.evaluation.gaussian_truth import gaussian_truth
from engine.quality.evaluation.ground_truth import read_ground_truth

_PENALTY = 300.0
"""Weight of the squared weights of standardised features; 1,000 does as well."""

_ROOM_WEIGHT = 150.0
"""Proposals that a room counts for on average, however many it has; the rooms of a family share theirs."""

_LEAST_SPREAD = 0.02
"""Added to the standard deviation of each feature: what nearly never occurs weighs little."""

_SPECS = {
    "odds": ArraySpec("float32", ("k",), finite=True),
    "features": ArraySpec("float32", ("k", 2560), finite=True),
    "iou": ArraySpec("float32", ("k",), finite=True),
}

Floats = NDArray[np.float64]

_NO_WEIGHTS: Floats = np.zeros(2560)


@dataclass(frozen=True)
class Measured:
    """K proposals of a room: half of their log-odds by the set, [K], their mean features, and IoU with an object.

    `family` says whose the exhibits are.
    """

    odds: NDArray[np.float32]
    features: NDArray[np.float32]
    iou: NDArray[np.float32]
    family: str = "own"


class _Features(OfflineVocabulary):
    """Describes crops by the features that are fitted, and leaves the odds of the sets as they are."""

    def whole_odds(self, described):  # type: ignore[no-untyped-def]
        return np.zeros(len(described), np.float32)


def measure(room: Path) -> Measured:
    """Return what `fit` needs of a room, measured once."""
    context = load_context(ProjectFolder.open_existing(room / "project"), BETTER, _Features, None)
    file, recipe = room / "wholeness.npz", stage_key("wholeness 2", context.graph.key)
    arrays = read_kept_arrays(file, recipe, _SPECS)
    if arrays is None:
        cameras = context.views.cameras
        truth = read_ground_truth(room / "truth", [one.photo for one in cameras.cameras], cameras.unregistered)
        labels = gaussian_truth(context.views.scene, cameras, truth, never_stop)
        things = csr_matrix(np.stack([labels == k for k in range(len(truth.objects))]), dtype=np.float32)
        looks = build_looks(context)
        iou = context.graph.iou(csr_matrix(looks.members, dtype=np.float32), things).max(axis=1)
        n = np.bincount(looks.proposal, minlength=len(looks.odds))
        rows = looks.proposal, np.arange(len(looks.proposal))
        total = csr_matrix((np.ones(len(looks.proposal)), rows), shape=(len(n), len(looks.proposal)))
        features = (total @ looks.described) / np.maximum(n, 1)[:, None]
        seen = n[looks.like] > 0
        arrays = {"odds": looks.odds[seen], "features": features[looks.like[seen]], "iou": iou[seen]}
        arrays = {name: np.asarray(value, np.float32) for name, value in arrays.items()}
        keep_arrays(file, recipe, arrays)
    made = read_json(room / "truth" / "room.json", {"exhibits": optional(str)}, advice="Render the room again.")
    return Measured(arrays["odds"], arrays["features"], arrays["iou"], made.get("exhibits", "own"))


def fit(rooms: Sequence[Measured], near: tuple[float, Floats] = (0.0, _NO_WEIGHTS)) -> tuple[float, Floats]:
    """Return bias b and weights w of expit(odds + b + w features) = IoU: logistic, ridge on standardised features.

    Each family of rooms has the same weight. The squared penalty is on the difference to the weights `near`.
    """
    odds, features, iou = (np.concatenate([getattr(room, name) for room in rooms]) for name in _SPECS)
    odds = odds + features @ near[1] + near[0]
    of_family = Counter(room.family for room in rooms)
    shares = [len(rooms) / len(of_family) / of_family[room.family] for room in rooms]
    counts = np.concatenate(
        [
            np.full(len(room.iou), share * _ROOM_WEIGHT / len(room.iou))
            for room, share in zip(rooms, shares, strict=True)
        ]
    )
    mean, spread = features.mean(axis=0), features.std(axis=0) + _LEAST_SPREAD
    standard = (features - mean) / spread

    def loss(fitted: Floats) -> tuple[float, Floats]:
        logits = odds + standard @ fitted[1:] + fitted[0]
        error = counts * (expit(logits) - iou)
        penalty = _PENALTY * (fitted[1:] ** 2).sum()
        value = (counts * (np.logaddexp(0, logits) - iou * logits)).sum() + penalty
        return value, np.concatenate([[error.sum()], error @ standard + 2 * _PENALTY * fitted[1:]])

    found = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 1000})
    weights = found.x[1:] / spread
    return float(found.x[0] - mean @ weights) + near[0], weights + near[1]


def log_loss(room: Measured, bias: float, weights: Floats) -> float:
    """Return the mean negative log-likelihood of the IoU, by the odds, the bias and the weights."""
    logits = room.odds + room.features @ weights + bias
    return float(np.mean(np.logaddexp(0, logits) - room.iou * logits))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the rooms, fit, and write the weights."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rooms.wholeness", description=__doc__)
    parser.add_argument("rooms", nargs="+", type=Path, metavar="ROOM", help="folder with project and truth")
    parser.add_argument("--near", type=Path, metavar="FILE", help="weights of other rooms that the fit stays near to")
    parser.add_argument("--out", type=Path, default=WEIGHTS_FILE, help="file of the weights (default: %(default)s)")
    options = parser.parse_args(arguments)
    try:
        measured = [measure(room) for room in options.rooms]
    except HeritageError as error:
        parser.error(str(error))
    near, others = (0.0, _NO_WEIGHTS), ""
    if options.near is not None:
        values = np.loadtxt(options.near)
        near, others = (float(values[0]), values[1:]), f", near to those of {options.near.name} before"
    left_out = [fit(measured[:k] + measured[k + 1 :], near) for k in range(len(measured))] if len(measured) > 1 else []
    losses = [log_loss(room, *fitted) for room, fitted in zip(measured, left_out, strict=False)]
    if losses:
        print(f"log-loss of the IoU in rooms left out: {np.mean(losses):.3f}")
    bias, weights = fit(measured, near)
    header = f"bias and weights of {len(measured)} rooms{others}, see benchmarks/rooms/wholeness.py"
    with atomic_write(options.out) as stream:
        np.savetxt(stream, [bias, *weights], "%.4g", header=header)
    print("Kept looks have odds of the former weights: raise _VERSION in engine/objects/looks.py.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
