"""The health check of the cameras: what the evidence says, as a colour, a likely cause and one sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene import FISHEYE_LENS, CameraHealth
from .evidence import BETTER, MUCH_BETTER, Evidence, PairFit
from .feature_scales import SIZES_DIFFER

_DEPARTURE = 0.03
"""Departure of an aspect (as a logarithm) or of a principal point (in sides of the photo) that counts: 3 %."""
_COMMON_ASPECT = 0.05
"""The same that all photos have, as a logarithm. Those of sound sets differ by at most 0.02, of zoomed ones by 0.04."""
# chosen on museum_room, room_1, room_3, room_5, herz_jesus25, sakharov_statue32
_ZOOMED = 0.72
"""Error with a lens for each photo, relative to that without, up to which zooms explain it. Zoomed sets have 0.43 to
0.65, damaged and cropped ones 0.80 to 0.83."""
# chosen on museum_room, room_1, room_3, room_5, herz_jesus25, sakharov_statue32
_PANORAMA_GAIN = 1.2
"""Matches that agree with panoramas, for each that agrees with ordinary photos, of photos that are panoramas."""
_HIGH_ERROR, _REFUTING_ERROR = 0.6, 1.0
"""Mean reprojection errors in pixels of the matched copies. Sound sets have 0.2 to 0.42, spoilt ones 0.3 to 1.3."""
# chosen on museum_room, room_1, room_3, room_5, banana16
_DISAGREEING = 0.2
"""Share of the strongest pairs that disagree with the cameras from which on something is repeated or misplaced: sound
sets have at most 0.06."""  # chosen on museum_room, room_1, room_3, room_5, banana16
TURNED = 0.9
"""Share of strong pairs that a turn of the camera explains, from which on it stood on one place."""
_MISSING = 0.07
"""Share of near views that lack the points of their neighbours from which on parts were taken for one: sound sets have
at most 0.03, equal walls of box rooms 0.1 to 0.2."""
# chosen on museum_room, room_1, room_3, room_5, room_7, banana16, herz_jesus25
_REFUTED_GIVEN = 0.5
"""Share of refuted photos from which on the whole given model is wrong."""
_SMALL_ANGLE = 2.0
"""Median ray angle in degrees below which depths are not known."""
_FAR_FROM_LINES = 1.0
"""Median distance in pixels of the matches from where given cameras say. True ones have 0.2, with a focal length that
is 10 % wrong 0.7, 50 % wrong 2.7."""
_LESS_EXACT = 4.0
"""Distance of the matches of a pair, relative to the median pair, from which on it disagrees with given cameras."""
# chosen on room_1, room_5
_AGREEING_PARTNERS = 0.34
"""Share of its partners that may agree with a photo that is refuted by the others."""  # chosen on room_1, room_5
_OTHER_PLACE = 0.3
"""Share of the photos in other models from which on they are named as another scene."""  # chosen on banana16
_LINKED = 2
"""Strong pairs of a placed photo and one of another model from which on they show one scene. Two scenes have none, sets
with several zooms 3 to 6."""  # chosen on museum_room, sakharov_statue32, banana16, room_1, room_7, box 1
_FEW_PLACED = 0.6
"""Share of placed photos below which most of a set is missing."""
_SOME_MISSING = 0.8
"""Share of placed photos below which several zooms are said to be the cause."""
_SOME_MISSING_OF_SEVERAL_SIZES = 0.9
"""The same where the photos show things in different sizes."""  # chosen on room_1, room_3, herz_jesus25
_WEAK_TRACKS = 0.25
"""Share of points seen by three photos below which a model hangs together by pairs. Sound sets have 0.76 to 1."""
_NAMES = 6
"""Photos that a sentence names."""
_NOT_SEPARATED = (
    "The photos seem to be taken with several zooms or lenses that could not be separated, so positions may be wrong: "
    "use the original files with their EXIF data, or photos of one zoom only."
)


def judge(evidence: Evidence, *, poses_given: bool = False, refuted: Sequence[str] = ()) -> CameraHealth:
    """Return the finding for a model.

    Parameters
    ----------
    poses_given : bool
        Whether the user gave the cameras.
    refuted : sequence of str
        Photos whose place their strongest pairs refute, by name.

    Returns
    -------
    CameraHealth
        Of several findings, the one that explains the others: a wrong kind of picture before a wrong place.
    """
    health = (
        _given(evidence, refuted)
        if poses_given
        else _of_pictures(evidence) or _of_lenses(evidence) or _of_places(evidence, refuted) or _of_error(evidence)
    )
    if health is not None:
        return health
    lenses = f" {evidence.n_lenses} lenses were found." if evidence.n_lenses > 1 else ""
    return CameraHealth("green", "", f"The photos agree with their cameras.{lenses}")


def _given(evidence: Evidence, refuted: Sequence[str]) -> CameraHealth | None:
    if evidence.distance > _FAR_FROM_LINES:
        return CameraHealth(
            "red",
            "given_cameras",
            f"The given cameras do not fit the photos: matches lie {evidence.distance:.1f} px from where the model "
            "says, usually 0.2 to 0.5; its focal lengths, distortion or poses are not those of these photos: check it, "
            "or let the cameras be estimated.",
        )
    if not refuted:
        return None
    if len(refuted) >= _REFUTED_GIVEN * max(evidence.n_placed, 1):
        return CameraHealth(
            "red",
            "given_cameras",
            f"The given cameras do not fit the photos: {len(refuted)} of {evidence.n_placed} photos do not match their "
            "neighbours where the model says; it belongs to other photos, another order or other lenses: check it, or "
            "let the cameras be estimated.",
            tuple(refuted),
        )
    return CameraHealth(
        "red",
        "given_cameras",
        f"The given cameras of {_listed(refuted)} do not fit these photos: files were exchanged or renamed after the "
        "model was made; restore their names, or let the cameras be estimated.",
        tuple(refuted),
    )


def _of_pictures(evidence: Evidence) -> CameraHealth | None:
    """Return the finding if the pictures are no plain photos of one lens: the model cannot be right then."""
    if evidence.mirrored:
        return CameraHealth(
            "red" if evidence.mirrored_placed else "yellow",
            "mirrored",
            f"Photos are mirror images of the others ({_listed(evidence.mirrored)}), as selfie cameras and some "
            "programs save them: flip them back.",
            evidence.mirrored_placed,
        )
    if evidence.panorama_gain >= _PANORAMA_GAIN:
        return CameraHealth(
            "red",
            "panorama",
            "The photos are 360 degree panoramas, for which the positions found are wrong: cut them into ordinary "
            "views first.",
        )
    # Photos of other zooms do not match, as those of other scenes.
    if not (_several_sizes(evidence) and evidence.regrouped) and (scenes := _of_scenes(evidence)):
        # Too few photos to recognise other lenses.
        return scenes
    found = []
    # Parts laid on each other bend a model: a lens that fits a little better does not explain what is missing.
    if (evidence.aspect_gain <= MUCH_BETTER and evidence.aspect > _DEPARTURE) or (
        evidence.aspect_gain <= BETTER and evidence.common_aspect > _COMMON_ASPECT and not _is_repeated(evidence)
    ):
        found.append((evidence.aspect_gain, "stretched"))
    if evidence.shift_gain <= MUCH_BETTER and evidence.shift > _DEPARTURE:
        found.append((evidence.shift_gain, "cropped"))
    if evidence.fisheye_gain <= MUCH_BETTER:
        found.append((evidence.fisheye_gain, "fisheye"))
    # Wrong focal lengths make other lenses fit better, too: what explains most of the error is the cause.
    zoomed = evidence.lenses_differ and evidence.own_gain <= _ZOOMED
    if not found or (zoomed and evidence.own_gain < min(found)[0]):
        return None
    cause = min(found)[1]
    if cause != "fisheye" and _several_sizes(evidence):
        return CameraHealth("red", "several_lenses", _NOT_SEPARATED)
    sentences = {
        "stretched": "The photos fit their cameras only when they are stretched in one direction, so positions are "
        "wrong: use the original files, not copies that a program resized or decoded wrongly.",
        "cropped": "The photos fit their cameras only when the lens looks beside the middle of the picture, so "
        "positions are wrong: use the photos before they were cropped.",
        "fisheye": "The photos fit fisheye lenses much better than the lens model used, so positions are wrong: choose "
        f"a fisheye lens (--lens {FISHEYE_LENS}).",
    }
    return CameraHealth("red", cause, sentences[cause])


def _of_scenes(evidence: Evidence) -> CameraHealth | None:
    others = [names for names in evidence.other_models if len(names) >= 3]
    n_others = len({name for names in others for name in names})
    share = n_others / evidence.n_photos
    most_missing = evidence.n_placed < _FEW_PLACED * evidence.n_photos
    if evidence.links < _LINKED and share >= (0.5 * _OTHER_PLACE if most_missing else _OTHER_PLACE):
        return CameraHealth(
            "yellow",
            "several_scenes",
            f"The photos show several scenes, or parts of one that no photo connects ({evidence.n_placed} photos are "
            f"used, {n_others} are not): reconstruct them one by one, or add photos between them.",
        )
    return None


def _of_lenses(evidence: Evidence) -> CameraHealth | None:
    if evidence.lenses_differ:
        return CameraHealth("red" if evidence.error > _HIGH_ERROR else "yellow", "several_lenses", _NOT_SEPARATED)
    least = _SOME_MISSING_OF_SEVERAL_SIZES if _several_sizes(evidence) else _SOME_MISSING
    if not (evidence.regrouped or _several_sizes(evidence)) or evidence.n_placed >= least * evidence.n_photos:
        return None
    lenses = f"{evidence.n_lenses} were found" if evidence.regrouped else "things have different sizes in them"
    return CameraHealth(
        "yellow",
        "several_lenses",
        f"The photos were taken with several zooms or lenses ({lenses}), and only "
        f"{evidence.n_placed} of {evidence.n_photos} could be placed: use the original files with their EXIF data, "
        "or add photos of one zoom.",
    )


def _several_sizes(evidence: Evidence) -> bool:
    """Return whether the photos fall into groups by the size in which they show things, as those of several zooms do.

    No model is needed to see that. A wrong model of zoomed photos fits better with any freedom of the lens.
    """
    return evidence.size_gap >= SIZES_DIFFER


def _is_repeated(evidence: Evidence) -> bool:
    """Return whether pairs or neighbours show that parts that look alike were taken for one."""
    return evidence.disagreeing >= _DISAGREEING or evidence.missing >= _MISSING


def _of_places(evidence: Evidence, refuted: Sequence[str]) -> CameraHealth | None:
    """Return the finding if photos lie in other places than the model says, or in none."""
    if evidence.turned >= TURNED or evidence.angle < _SMALL_ANGLE:
        return CameraHealth(
            "red",
            "one_place",
            "The photos were taken from nearly one place, with the camera turned, so depths are not known: walk around "
            "the object.",
        )
    if _is_repeated(evidence):
        what = (
            f"{evidence.disagreeing:.0%} of the pairs of photos that match best contradict the positions found"
            if evidence.disagreeing >= _DISAGREEING
            else f"{evidence.missing:.0%} of the photos placed side by side do not show the same things"
        )
        return CameraHealth(
            "red",
            "repeated",
            f"{what}: parts that look alike, as equal walls or windows, were taken for one; add photos that show how "
            "they are connected.",
            tuple(refuted),
        )
    if refuted:
        return CameraHealth(
            "yellow",
            "misplaced",
            f"The best matches of {_listed(refuted)} contradict the position found, so they are left out: they may "
            "show another place that looks alike.",
            tuple(refuted),
        )
    if evidence.n_placed < _FEW_PLACED * evidence.n_photos:
        return CameraHealth(
            "yellow",
            "few_placed",
            f"Only {evidence.n_placed} of {evidence.n_photos} photos could be placed: the others overlap too little, "
            "are blurred or show something else; add photos between them.",
        )
    if evidence.seen_by_three < _WEAK_TRACKS:
        return CameraHealth(
            "yellow",
            "weak_tracks",
            f"Only {evidence.seen_by_three:.0%} of the points are seen by three photos, so parts of the scene may "
            "have different scales: take photos that overlap by two thirds.",
        )
    return None


def _of_error(evidence: Evidence) -> CameraHealth | None:
    if not evidence.error > _HIGH_ERROR:
        return None
    return CameraHealth(
        "red" if evidence.error > _REFUTING_ERROR else "yellow",
        "unclear",
        f"The photos fit their cameras badly ({evidence.error:.2f} px on average, usually 0.2 to 0.4): the files may "
        "be damaged, or changed by a program, or the scene or the lens moved; look at the photos and the cameras.",
    )


def refuted_images(pairs: Sequence[PairFit], *, exact: bool = False) -> list[int]:
    """Return the image ids of photos that disagree with nearly all, and at least two, of their strongest partners.

    Of photos that disagree with each other only, as two exchanged files do with their common neighbours, those with
    the least agreement are taken first, and what they explain does not count against the others.

    Parameters
    ----------
    exact : bool
        Whether the cameras are exact where they are right, as given ones are. Then pairs that agree much less exactly
        than usual disagree too, and a third of the partners may agree: neighbours that were exchanged still agree with
        each other.
    """
    usual = float(np.median([pair.distance for pair in pairs])) if pairs else 0.0
    agreeing = {
        pair: pair.agrees and (not exact or pair.distance <= max(_FAR_FROM_LINES, _LESS_EXACT * usual))
        for pair in pairs
    }
    allowed = _AGREEING_PARTNERS if exact else 0.0
    left = list(pairs)
    refuted: list[int] = []
    while True:
        by_image: dict[int, list[bool]] = {}
        for pair in left:
            by_image.setdefault(pair.first, []).append(agreeing[pair])
            by_image.setdefault(pair.second, []).append(agreeing[pair])
        wrong = {
            image_id: (sum(found) / len(found), -len(found), image_id)
            for image_id, found in by_image.items()
            if len(found) - sum(found) >= 2 and sum(found) <= allowed * len(found)
        }
        if not wrong:
            return sorted(refuted)
        worst = min(wrong, key=lambda image_id: wrong[image_id])
        refuted.append(worst)
        left = [pair for pair in left if worst not in (pair.first, pair.second)]


def are_refuted(pairs: Sequence[PairFit]) -> bool:
    """Return whether `pairs` refute given cameras: those of a photo, or of all."""
    distance = float(np.median([pair.distance for pair in pairs])) if pairs else 0.0
    return distance > _FAR_FROM_LINES or bool(refuted_images(pairs, exact=True))


def _listed(names: Sequence[str]) -> str:
    if len(names) <= _NAMES:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMES])} and {len(names) - _NAMES} more"
