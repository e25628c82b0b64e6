"""Where evidence comes from: a click, a box or a mask becomes masks in views (`engine.objects.votes.MaskEvidence`).

A mask is given by the user, drawn by SAM for a box, or that of the segment under a click.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Float32, Floats, Mask
from ..core.errors import PromptError
from .context import SegmentationContext
from .graph import N_NEIGHBOURS
from .grounding import Detector, PromptCheck
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Place, Point, camera_of_prompt, load_mask
from .settings import PAPER
from .spatial import parse_spatial
from .views import View, Views
from .votes import MaskEvidence

_MAX_MEANT = 3
"""Texts that are suggested for an unknown one."""

_MAX_NEAREST = 5
"""Known words that the message about an unknown text lists."""

_SPOT_RADIUS = 2
"""Radius of a clicked place in pixels of the view's frame: a smaller spot may fall between the pixels of the frame."""

_MIN_PART_WEIGHT = 0.1  # chosen on museum_room
"""Smallest weight of a connected part relative to the heaviest: an occluder cuts off more than that."""

_CELL_WIDTH = 0.1  # chosen on museum_room
"""Width of the cells that connect points, relative to the radius of what the mask shows."""


def find_evidence(prompt: ClickPrompt | BoxPrompt | MaskPrompt, context: SegmentationContext) -> list[MaskEvidence]:
    """Return masks that show the object of `prompt`, at least one, and those of what does not belong to it.

    Raises
    ------
    PromptError
        When the photo is unknown, or no mask was found at a place or in a box.
    MaskError
        When a given mask cannot be used.
    """
    if isinstance(prompt, ClickPrompt):
        return evidence_of_clicks(prompt.clicks, prompt.excluded, context)
    camera = camera_of_prompt(prompt, context.views.cameras)
    view = context.views.of(camera)
    if isinstance(prompt, MaskPrompt):
        evidence = MaskEvidence(view, view.from_photo(load_mask(prompt.mask, camera)), 1.0)
    else:
        corners = np.array([[prompt.x0, prompt.y0], [prompt.x1, prompt.y1]])
        x0, y0, x1, y1 = np.clip(corners, 0, [camera.width, camera.height]).ravel().tolist()
        outside = places_in(camera.photo, prompt.excluded)
        mask, score = context.photos.segment(camera, outside=outside, box=(x0, y0, x1, y1))
        evidence = MaskEvidence(view, view.from_photo(mask), score)
    return [require_mask(evidence), *evidence_of_exclusions((), prompt.excluded, context)]


def evidence_of_clicks(
    clicks: Sequence[Point], excluded: Sequence[Point], context: SegmentationContext
) -> list[MaskEvidence]:
    """Return one mask for each clicked photo, without SAM, and those of `evidence_of_exclusions`.

    Raises
    ------
    PromptError
        For a click outside of its photo, or an excluded one where no mask was found.
    """
    shown = [evidence_of_places(places, view, context) for view, places in clicks_by_photo(clicks, context)]
    return [*shown, *evidence_of_exclusions(clicks, excluded, context)]


def evidence_of_exclusions(
    clicks: Sequence[Point], excluded: Sequence[Point], context: SegmentationContext
) -> list[MaskEvidence]:
    """Return SAM's mask of the excluded clicks of each photo.

    Parameters
    ----------
    clicks : sequence of Point
        Clicks on the object: background points for SAM in the same photo.

    Raises
    ------
    PromptError
        For a click outside of its photo, or where no mask was found.
    """
    evidence = []
    for view, places in clicks_by_photo(excluded, context):
        outside = places_in(view.camera.photo, clicks)
        mask, score = context.photos.segment(view.camera, points=places, outside=outside)
        evidence.append(require_mask(MaskEvidence(view, view.from_photo(mask), score, excluded=True)))
    return evidence


def evidence_of_places(places: Sequence[Place], view: View, context: SegmentationContext) -> MaskEvidence:
    """Return what clicked places of a view show: where the photo has segments, those under the clicks.

    A segment is often only a part of the object. Known are therefore the Gaussians with a feature like that of a
    clicked pixel, as far as they are connected to what the mask shows.

    Parameters
    ----------
    places : sequence of (float, float)
        x, y in pixels of the picture of `view`.
    view : View
        That of a photo, or of any other camera (`Views.from_anywhere`).

    Raises
    ------
    PromptError
        For a place on the rim that the frame of the view does not show.
    """
    columns, rows = np.transpose([pixel_of(view, x, y) for x, y in places])
    mask = np.zeros(view.within.shape, bool)
    mask[rows, columns] = True
    if view.camera.photo in context.label_maps:
        labels = view.labels_from_photo(context.label_maps[view.camera.photo])
        mask |= np.isin(labels, labels[rows, columns]) & (labels > 0)
    else:
        # Without a kernel, OpenCV takes the pixel and its 8 neighbours.
        mask = cv2.dilate(mask.astype(np.uint8), None) > 0
    item = MaskEvidence(view, mask & view.within, 1.0)
    clicked = view.features[rows, columns][view.covered[rows, columns]]
    similar = (context.views.directions @ clicked.T).max(axis=1, initial=-1) >= PAPER.cosine
    members = connected_members(similar, item, context.views)
    if not members.any():
        return item
    shown = context.views.visible(view, members)
    return replace(item, mask=item.mask | (shown & view.within), members=members)


def connected_members(members: Mask, item: MaskEvidence, views: Views) -> Mask:
    """Return which members are connected to what a mask shows, see `connected_parts`.

    Parameters
    ----------
    members : array of shape [N], bool

    Returns
    -------
    array of shape [N], bool
    """
    pixels = views.scene.votes(item.view.frame, item.mask[..., None].astype(np.float32))[:, 0]
    connected = np.zeros_like(members)
    connected[members] = connected_parts(views.scene.gaussians.means[members], pixels[members])
    return connected


def connected_parts(points: Float32, weights: Floats) -> Mask:
    """Return the connected parts of points that a mask shows; all if the mask shows none of them.

    Points are connected through neighbouring cells of a grid, as wide as a tenth of the radius of what the mask shows,
    and at least as far as the neighbours of a point usually reach. Kept are the part with the largest total weight, and
    every other one with at least a tenth of it: an occluder may split an object in two.

    Parameters
    ----------
    points : array of shape [M, 3], float32
        World units.
    weights : array of shape [M], float
        Pixels of the mask that each point contributes.

    Returns
    -------
    array of shape [M], bool
    """
    total = float(weights.sum())
    from scipy.spatial import cKDTree  # accepting a picture shall not wait for it

    if len(points) <= 2 or total <= 0:
        return np.ones(len(points), bool)
    share = weights.astype(np.float64) / total
    radius = float(np.sqrt(share @ ((points - share @ points) ** 2).sum(axis=1)))
    farthest = cKDTree(points).query(points, k=min(N_NEIGHBOURS + 1, len(points)))[0][:, -1]
    cell = max(_CELL_WIDTH * radius, float(np.median(farthest)), float(np.finfo(np.float32).eps))
    keys, cell_of = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    # On no axis farther than one cell: the 26 cells around.
    pairs = cKDTree(keys).query_pairs(1, p=np.inf, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(keys), len(keys)))
    part = connected_components(links, directed=False)[1][cell_of.reshape(-1)]
    weight = np.bincount(part, weights=weights)
    return np.asarray((weight >= _MIN_PART_WEIGHT * weight.max())[part] & (weight > 0)[part])


def clicks_by_photo(clicks: Sequence[Point], context: SegmentationContext) -> list[tuple[View, list[Place]]]:
    """Return the view and the clicked places of each photo.

    Raises
    ------
    PromptError
        For an unknown photo, or a click outside of its photo.
    """
    cameras = {point.photo: camera_of_prompt(point, context.views.cameras) for point in clicks}
    return [(context.views.of(camera), places_in(photo, clicks)) for photo, camera in cameras.items()]


def places_in(photo: str, points: Sequence[Point]) -> list[Place]:
    """Return the places, x, y, of those points that are in a photo."""
    return [(point.x, point.y) for point in points if point.photo == photo]


def require_mask(evidence: MaskEvidence) -> MaskEvidence:
    """Return `evidence`.

    Raises
    ------
    PromptError
        When its mask is empty.
    """
    if not evidence.mask.any():
        photo = evidence.view.camera.photo
        raise PromptError(f"Nothing was found at that place of {photo}. Click on the middle of the object.")
    return evidence


def pixel_of(view: View, x: float, y: float) -> tuple[int, int]:
    """Return column and row of the pixel in the view's frame that shows a point of the photo.

    Parameters
    ----------
    x, y : float
        Pixels of the photo at full size.

    Raises
    ------
    PromptError
        When the frame does not show the point, which lies on the rim.
    """
    spot = np.zeros((view.camera.height, view.camera.width), np.uint8)
    radius = max(_SPOT_RADIUS, round(_SPOT_RADIUS * max(spot.shape) / max(view.frame.width, view.frame.height)))
    cv2.circle(spot, (int(x), int(y)), radius, 1, thickness=-1)
    rows, columns = np.nonzero(view.from_photo(spot > 0))
    if len(rows) == 0:
        raise PromptError(f"The click {x:g},{y:g} lies on the very rim of {view.camera.photo}. Click farther inside.")
    return int(round(float(columns.mean()))), int(round(float(rows.mean())))


def meant_by(text: str, detector: Detector) -> list[str]:
    """Return texts that an unknown text may have been meant for, at most three; none for a known one."""
    noun = parse_spatial(text).noun
    check = detector.check_prompt(noun)
    if check.known:
        return []
    # Only the noun changes in "the left tepot".
    return [text.replace(noun, word) if noun in text else word for word, _ in check.matches][:_MAX_MEANT]


def require_known(text: str, context: SegmentationContext) -> None:
    """Raise an error for a text that the detector does not know.

    Raises
    ------
    PromptError
        Its message lists the nearest words that the detector knows.
    """
    check = context.detector.check_prompt(text)
    if not check.known:
        raise PromptError(unknown_word(text, check))


def unknown_word(text: str, check: PromptCheck) -> str:
    """Return why a text that a detector does not know is refused, with the nearest words that it knows."""
    sentence = check.message or f"The detector does not know {text!r}."
    nearest = [word for word, _ in check.matches][:_MAX_NEAREST]
    if any(word not in sentence for word in nearest):
        sentence = f"{sentence.rstrip('.')}. The nearest words it knows: {', '.join(nearest)}."
    if "click" not in sentence.lower():
        sentence += " You can click on the object instead."
    return sentence
