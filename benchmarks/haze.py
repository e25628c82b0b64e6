"""What surrounds objects in views that no photo has: ``python -m benchmarks.haze --doc docs/detail.md``.

In the kept choosing rooms (`benchmarks.rooms`) the true shape of each exhibit is known. Each is isolated by one true
mask, rendered alone, with and without detail, from views above, nearer and farther than the photos, and compared with
its true silhouette there, which Blender renders.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image

from engine.cameras.normalise import normalised_viewmat
from engine.core.arrays import Float64, Mask
from engine.core.events import never_stop
from engine.masks import load_default_sam
from engine.objects import DetailPhotos, Views, detail_object, load_context
from engine.objects.context import SegmentationContext
from engine.objects.grounding import load_default_detector
from engine.objects.lifting import isolate_object
from engine.objects.settings import BETTER
from engine.objects.views import spread_cameras
from engine.objects.votes import MaskEvidence
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import read_ground_truth
from engine.quality.evaluation.ground_truth import GroundTruth
from engine.quality.evaluation.settings import MARKS
from engine.rasterizer.settings import Backend
from engine.scene import Gaussians, PinholeCamera

from .camera_health.box_room import looking_along
from .detail import share_of_needles
from .documents import print_table
from .places import run_room_script
from .rooms.drawn import drawn_from
from .rooms.draws import CHOOSING_ROOMS
from .rooms.keeping import unpack_kept
from .training.off_path_views import raised

_ROOMS = CHOOSING_ROOMS[::2]
"""Detail of all exhibits of all rooms would take an hour."""

_SIDE = 256
"""Width and height of the views, in pixels."""
_N_DIRECTIONS = 8
"""Photos of the directions."""
_DISTANCES = (0.5, 1.5)
"""Distances of the other views, relative to those of their photos."""
_FILLS = 1 / 3
"""Share of half a view's width that the radius of an object takes."""
_MIN_DISTANCE = 1.5
"""Smallest distance of a camera from the middle of an object, in its radii."""
_EDGE = 1
"""Pixels on each side of the edge of a silhouette that are not compared."""


@dataclass(frozen=True)
class Figures:
    """Percent of the true silhouette, means over the views, and percent of the Gaussians."""

    haze: float
    missing: float
    needles: float


@dataclass(frozen=True)
class Exhibit:
    """An isolated exhibit and where it is seen from.

    Attributes
    ----------
    name : str
    members : array of shape [N], bool
    frames : tuple of PinholeCamera
        In the world of the project.
    """

    name: str
    members: Mask
    frames: tuple[PinholeCamera, ...]


def exhibits_of(context: SegmentationContext, truth: GroundTruth) -> Iterator[Exhibit]:
    """Yield each exhibit as the true mask isolates it that is largest in the photos."""
    for name in truth.objects:
        masks = {camera.photo: truth.masks(camera.photo).get(name) for camera in context.views.cameras.cameras}
        seen = {photo: mask for photo, mask in masks.items() if mask is not None and mask.any()}
        if not seen:
            continue
        photo = max(seen, key=lambda one: int(seen[one].sum()))
        view = context.views.of(context.views.cameras.by_photo[photo])
        found = isolate_object(context, [MaskEvidence(view, view.from_photo(seen[photo]), 1.0)])
        yield Exhibit(name, found.members, tuple(unseen_frames(context.views, found.members)))


def unseen_frames(views: Views, members: Mask) -> Iterator[PinholeCamera]:
    """Yield views of an object from the directions of the photos, higher, nearer and farther."""
    means = views.scene.gaussians.means[members].astype(np.float64)
    middle = np.median(means, axis=0)
    radius = float(np.quantile(np.linalg.norm(means - middle, axis=1), 0.95))
    for camera in spread_cameras(views.facing(middle), _N_DIRECTIONS):
        rotation, shift = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
        offset = -rotation.T @ shift - middle
        for one in (raised(offset), *(offset * factor for factor in _DISTANCES)):
            eye = one * max(1.0, _MIN_DISTANCE * radius / float(np.linalg.norm(one)))
            yield _looking_at(middle + eye, middle, radius)


def _looking_at(eye: Float64, middle: Float64, radius: float) -> PinholeCamera:
    """Return a view from `eye` that an object of this radius fills as `_FILLS` says. Z is up."""
    focal = _FILLS * _SIDE / 2 * float(np.linalg.norm(middle - eye)) / radius
    K = np.array([[focal, 0, _SIDE / 2], [0, focal, _SIDE / 2], [0, 0, 1]])
    return PinholeCamera(looking_along(eye, middle - eye), K, _SIDE, _SIDE)


def silhouettes(room: Path, exhibits: Sequence[Exhibit], original_from_world: Float64) -> dict[str, list[Mask]]:
    """Return the true silhouettes of the exhibits in their frames, bool [side, side] each.

    Parameters
    ----------
    room : Path
        With ``truth/room.json``.
    exhibits : sequence of Exhibit
    original_from_world : array of shape [4, 4]
        From the world of the project to that of the room.
    """
    made = drawn_from(room)
    world_from_original = np.linalg.inv(original_from_world)
    views = {
        one.name: [
            {"viewmat": normalised_viewmat(frame.viewmat, world_from_original).tolist(), "focal": frame.K[0, 0]}
            for frame in one.frames
        ]
        for one in exhibits
    }
    with tempfile.TemporaryDirectory() as name:
        file, out = Path(name) / "cameras.json", Path(name) / "silhouettes"
        file.write_text(json.dumps({"side": _SIDE, "views": views}), encoding="utf-8")
        run_room_script("make_silhouettes.py", "--cameras", file, "--out", out, *made)
        return {
            one.name: [
                np.asarray(Image.open(out / f"{one.name}_{number}.png")) > 0 for number in range(len(one.frames))
            ]
            for one in exhibits
        }


def figures(gaussians: Gaussians, frames: Sequence[PinholeCamera], true: Sequence[Mask]) -> Figures:
    """Compare an object alone with its true silhouettes, as docs/detail.md says."""
    scene, kernel = Scene(gaussians), np.ones((2 * _EDGE + 1, 2 * _EDGE + 1), np.uint8)
    shares = []
    for frame, mask in zip(frames, true, strict=True):
        if not mask.any():
            continue
        alpha = scene.render(frame, color=True).alpha
        outside = cv2.dilate(mask.astype(np.uint8), kernel) == 0
        inside = cv2.erode(mask.astype(np.uint8), kernel) > 0
        shares.append((alpha[outside].sum() / mask.sum(), (1 - alpha[inside]).sum() / mask.sum()))
    haze, missing = 100 * np.mean(shares, axis=0)
    return Figures(float(haze), float(missing), share_of_needles(gaussians))


def measured(room: Path, backend: Backend) -> Iterator[tuple[Figures, Figures]]:
    """Yield the figures of each exhibit of a room, as it is in the scene and with detail, which `backend` makes."""
    project = ProjectFolder.open_existing(room / "project")
    context = load_context(project, BETTER, load_default_detector, load_default_sam)
    cameras = context.views.cameras
    truth = read_ground_truth(room / "truth", list(cameras.by_photo))
    exhibits = list(exhibits_of(context, truth))
    true = silhouettes(room, exhibits, cameras.original_from_world)
    photos = DetailPhotos.of(project)
    views = replace(context.views, scene=Scene(context.views.scene.gaussians, backend=backend))
    for one in exhibits:
        trained = replace(context.views.scene.gaussians[one.members], features=None)
        result = detail_object(views, photos, one.members, BETTER, should_stop=never_stop)
        detailed = trained if result.detailed is None else result.detailed.gaussians
        before, after = (figures(each, one.frames, true[one.name]) for each in (trained, detailed))
        sys.stderr.write(f"{room.name} {one.name}: {before} {after}\n")
        yield before, after


def table(rooms: Mapping[str, Sequence[tuple[Figures, Figures]]]) -> str:
    """Return the Markdown table: a row for each room, then the mean of all exhibits, and the worst."""
    lines = [
        "| room | exhibits | haze | detail | worst haze | detail | missing | detail | needles | detail |",
        "| --- |" + " ---: |" * 9,
    ]
    everything = [pair for pairs in rooms.values() for pair in pairs]
    for name, pairs in {**rooms, "**all**": everything}.items():
        sides = [list(side) for side in zip(*pairs, strict=True)]
        haze, missing, needles = (
            [np.array([getattr(one, figure) for one in side]) for side in sides]
            for figure in ("haze", "missing", "needles")
        )
        cells = [f"{values.mean():.1f}" for values in haze] + [f"{values.max():.0f}" for values in haze]
        cells += [f"{values.mean():.1f}" for values in missing] + [f"{values.mean():.0f}" for values in needles]
        lines.append(f"| {name} | {len(pairs)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the kept rooms and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.haze", description=__doc__)
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    parser.add_argument("--device", choices=("cpu", "gpu"), default="cpu", help="of detail (default: %(default)s)")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    rooms: dict[str, list[tuple[Figures, Figures]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for room in _ROOMS:
            unpack_kept(room.name, Path(folder) / room.name)
            rooms[room.name] = list(measured(Path(folder) / room.name, options.device))
    print_table(table(rooms), options.doc, "haze", MARKS["in sample"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
