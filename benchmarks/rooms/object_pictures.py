"""Pictures of the steps from a mask to an object: ``python -m benchmarks.rooms.object_pictures``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse import csr_matrix

from engine.core.errors import ProjectError
from engine.masks import load_default_sam
from engine.objects import SegmentationContext, View, load_context
from engine.objects.settings import BETTER
from engine.project.folder import ProjectFolder

from ..places import ROOT
from .keeping import unpack_kept

_WIDTH = 320
_COLOR = np.array([255, 60, 40], np.float32)
_GAP = 6
_CARRIED = "room_5"
"""Kept room with a ship that segments join with its pedestal."""

Picture = NDArray[np.float32]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write one JPEG for each step."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rooms.object_pictures", description=__doc__)
    parser.add_argument("--room", default="room_4", help="kept choosing room (default: %(default)s)")
    parser.add_argument("--object", default="urn", metavar="NAME", help="object of the room (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder (default: docs)")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        project = unpack_kept(options.room, Path(folder) / options.room)
        write_pictures(project, Path(folder) / options.room / "truth", options.object, options.out)
        project = unpack_kept(_CARRIED, Path(folder) / f"{_CARRIED}-carried")
        write_support_picture(project, options.out)
    return 0


def write_pictures(project: Path, truth: Path, name: str, out: Path) -> None:
    """Write the pictures of one object, prompted by its true mask in the photo that shows it largest."""
    from engine.objects import find_everything
    from engine.objects.grounding import load_default_detector
    from engine.objects.lifting import isolate_object
    from engine.objects.votes import MaskEvidence, count_votes
    from engine.quality.evaluation.ground_truth import read_ground_truth

    context = load_context(ProjectFolder.open_existing(project), BETTER, load_default_detector, load_default_sam)
    cameras = context.views.cameras.by_photo
    masks = read_ground_truth(truth, list(cameras), (), layout="auto")
    shown = {photo: masks.masks(photo)[name] for photo in cameras if name in masks.masks(photo)}
    if len(shown) < 2:
        raise ProjectError(f"The room has no {name!r} in two photos, only: {', '.join(masks.objects)}.")
    first, second = sorted(shown, key=lambda photo: -int(shown[photo].sum()))[:2]
    view, other = context.views.of(cameras[first]), context.views.of(cameras[second])
    evidence = MaskEvidence(view, view.from_photo(shown[first]), 1.0)
    votes = count_votes(context.views, evidence, context.graph.pixels)
    share = votes.inside / np.maximum(votes.inside + votes.outside, 1e-6)
    seen = (votes.inside + votes.outside > 0.5).astype(np.float32)
    membership = isolate_object(context, [evidence]).membership
    levels = isolate_object(context, [evidence]).levels
    groups = [one.members for one in find_everything(context)]
    _write(out / "objects_evidence.jpg", [_photo(context, view), _tinted(_photo(context, view), evidence.mask)])
    _write(out / "objects_votes.jpg", [_blended(context, one, share * seen) for one in (view, other)])
    _write(out / "objects_segments.jpg", [_segments(context, one) for one in (view, other)])
    _write(out / "objects_membership.jpg", [_blended(context, one, membership) for one in (view, other)])
    parts = [_tinted(_photo(context, other), context.views.scene.share(other.frame, one >= 0.5) > 0.5)
             for one in levels.memberships]  # fmt: skip
    _write(out / "objects_levels.jpg", parts)
    _write(out / "objects_all.jpg", [_colored(context, one, groups) for one in (view, other)])


def write_support_picture(project: Path, out: Path) -> None:
    """Write what *Find All* chooses and changes most by what it stands on, before and after that."""
    from engine.objects.choosing import whole_versions
    from engine.objects.grounding import load_default_detector
    from engine.objects.looks import load_or_build_looks
    from engine.objects.proposals import choose_sets, gains_of
    from engine.objects.support import standing

    context = load_context(ProjectFolder.open_existing(project), BETTER, load_default_detector, load_default_sam)
    looks = load_or_build_looks(context)
    chosen = looks.members[whole_versions(looks, choose_sets(looks.members, gains_of(looks.odds)))]
    pairs = [(one, standing(one, context.surfaces, context.means)) for one in chosen]
    before, after = max(pairs, key=lambda pair: float((pair[0] ^ pair[1]).sum() / pair[0].sum()))
    shown = context.graph.shown(csr_matrix(before[None], dtype=np.float32))
    view = context.views.of(context.views.cameras.by_photo[context.graph.photos[int(shown.argmax())]])
    pictures = [_tinted(_photo(context, view), context.views.visible(view, one)) for one in (before, after)]
    _write(out / "objects_support.jpg", pictures)


def _photo(context: SegmentationContext, view: View) -> Picture:
    return context.views.scene.render(view.frame, color=True).channels.clip(0, 1) * 255


def _tinted(picture: Picture, weight: NDArray[np.generic], color: NDArray[np.float32] = _COLOR) -> Picture:
    opacity = 0.6 * weight.astype(np.float32)[..., None]
    return picture * (1 - opacity) + color * opacity


def _blended(context: SegmentationContext, view: View, values: NDArray[np.float32]) -> Picture:
    """Return the picture tinted by a value of each Gaussian."""
    weight = context.views.scene.render(view.frame, channels=values[:, None]).channels[..., 0]
    return _tinted(0.5 * _photo(context, view), weight.clip(0, 1))


def _segments(context: SegmentationContext, view: View) -> Picture:
    labels = view.labels_from_photo(context.label_maps[view.camera.photo])
    colors = np.random.default_rng(0).uniform(40, 255, (int(labels.max()) + 1, 3)).astype(np.float32)
    colors[0] = 0
    return 0.4 * _photo(context, view) + 0.6 * colors[labels]


def _colored(context: SegmentationContext, view: View, groups: Sequence[NDArray[np.bool_]]) -> Picture:
    picture = 0.6 * _photo(context, view)
    for number, color in enumerate(np.random.default_rng(1).uniform(60, 255, (len(groups), 3)).astype(np.float32)):
        picture = _tinted(picture, context.views.scene.share(view.frame, groups[number]) > 0.5, color)
    return picture


def _write(file: Path, pictures: Sequence[Picture]) -> None:
    """Write pictures side by side."""
    scaled = [
        cv2.resize(picture, (_WIDTH, round(_WIDTH * picture.shape[0] / picture.shape[1])), interpolation=cv2.INTER_AREA)
        for picture in pictures
    ]
    height = max(picture.shape[0] for picture in scaled)
    sheet = np.full((height, len(scaled) * (_WIDTH + _GAP) - _GAP, 3), 255, np.uint8)
    for number, picture in enumerate(scaled):
        left = number * (_WIDTH + _GAP)
        sheet[: picture.shape[0], left : left + _WIDTH] = picture.clip(0, 255)
    Image.fromarray(sheet).save(file, quality=80)


if __name__ == "__main__":
    sys.exit(main())
