"""Evidence of a model and its matches about the cameras: the figures that `health` judges.

Every figure compares the model with something that it was not fitted to: other lenses, matches between photos that it
does not explain, mirror images, other camera types.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.events import StopCheck
from .colmap import pycolmap
from .colmap_calls import lens_of, opened_database, verified_pairs
from .lens_trials import LensTrial, ModelTrials, tried_lenses, with_aspect

_MIN_MATCHES = 30
"""Verified matches from which on a pair counts. Pairs with fewer are often wrong where patterns repeat."""
_PIXELS = 4.0
"""Distance from its epipolar line up to which a match agrees with the cameras: COLMAP's own in verification."""
_STRONGEST = 4
"""Partners of a photo, those with the most matches, that must agree with it."""
_PANORAMA_ASPECT = 1.8
"""Width by height of photos that can be panoramas: whole ones have 2, without their poles more."""
_PANORAMA_PAIRS = 8
_BY_HOMOGRAPHY = (
    pycolmap.TwoViewGeometryConfiguration.PLANAR.value,
    pycolmap.TwoViewGeometryConfiguration.PANORAMIC.value,
    pycolmap.TwoViewGeometryConfiguration.PLANAR_OR_PANORAMIC.value,
)
_FOCALS = tuple(np.geomspace(0.4, 4.0, 40))
"""Focal lengths to try, in longest sides of the photos."""
_TURN = 0.03
"""Departure of a homography from a turn that still counts as one. The steps of `_FOCALS` alone make up to 0.02."""
_NEAR_COSINE = float(np.cos(np.radians(15.0)))
_FOUND_AGAIN = 0.3
"""Share of the points of a near view from which down it lacks them. Sound sets have 0.35 and more, but for one view in
32 of ``herz_jesus25``."""  # chosen on museum_room, room_1, room_3, room_5, room_7, banana16, herz_jesus25
_MIN_NEAR = 4
"""Near views that are needed to say something."""
MUCH_BETTER = 0.9
"""Error with another lens, relative to that with the present one, up to which the present one is refuted:
sound sets have 0.96 to 1."""  # chosen on museum_room, room_1, room_3, room_5, banana16
BETTER = 0.95
"""The same where all photos say the same about their lens."""  # chosen on as `MUCH_BETTER`, and sakharov_statue32
_COMMON = 0.9
"""Share of the photos that make a departure a common one."""
_SAME_SIZE = 1.3
"""Factor within which a point has the same size in two photos, so that it can be found again."""
_FISHEYE = "SIMPLE_RADIAL_FISHEYE"


@dataclass(frozen=True)
class PairFit:
    """How the verified matches between two placed photos agree with their cameras.

    `share` of them lie within 4 pixels of their epipolar lines; `distance` is their median distance in pixels.
    """

    first: int
    second: int
    share: float
    distance: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether at least half of the matches agree."""
        return self.share >= 0.5


@dataclass(frozen=True)
class Evidence:
    """Figures of a model.

    Attributes
    ----------
    n_photos, n_placed : int
    error : float
        Mean reprojection error, pixels of the matched copies; NaN when unknown.
    seen_by_three : float
        Share of the points that at least three photos see.
    angle : float
        Median over the points of the largest angle between two of their rays, degrees.
    aspect, aspect_gain : float
        Median departure of the photos' horizontal from their vertical focal length, as the logarithm of the ratio, and
        the error with two focal lengths relative to that with one.
    common_aspect : float
        Median of that logarithm without its sign, if nine of ten photos have it with one sign; else 0.
    shift, shift_gain : float
        Median distance of the principal points from the middle of the photos, in sides of the photo, and the error with
        them relative to that without.
    fisheye_gain : float
        The error with fisheye lenses relative to that with ordinary ones.
    panorama_gain : float
        Matches that agree when the photos are taken for panoramas, relative to those with their lenses; 0 when not
        tried.
    turned : float
        Share of the strong pairs that a turn of the camera on one place explains.
    missing : float
        Share of near views in which most points of the other photo were not found again.
    lenses_differ : bool
        Whether photos that share a lens fit clearly better with different ones.
    own_gain : float
        The error with a lens for each photo relative to that with the lenses of the model.
    size_gap : float
        How far apart photos that began with one lens fall into groups by the size in which they show things, see
        `feature_scales.size_gap`; 1 for sizes that change little by little.
    n_lenses, n_groups : int
        Lenses of the model, and groups of its photos that differ in size or EXIF; 0 where unknown.
    pairs : tuple of PairFit
        The strongest pairs of each placed photo.
    other_models : tuple of tuple of str
        Photos of further models, in addition to this one.
    links : int
        Strong pairs of a placed photo and one that is not placed.
    mirrored, mirrored_placed : tuple of str
        Photos that match the others as mirror images only, and those of them that the model places.
    """

    n_photos: int
    n_placed: int
    error: float
    seen_by_three: float = 1.0
    angle: float = 90.0
    aspect: float = 0.0
    aspect_gain: float = 1.0
    common_aspect: float = 0.0
    shift: float = 0.0
    shift_gain: float = 1.0
    fisheye_gain: float = 1.0
    panorama_gain: float = 0.0
    turned: float = 0.0
    missing: float = 0.0
    lenses_differ: bool = False
    own_gain: float = 1.0
    size_gap: float = 1.0
    n_lenses: int = 1
    n_groups: int = 0
    pairs: tuple[PairFit, ...] = ()
    other_models: tuple[tuple[str, ...], ...] = ()
    links: int = 0
    mirrored: tuple[str, ...] = ()
    mirrored_placed: tuple[str, ...] = ()

    @property
    def regrouped(self) -> bool:
        """Whether photos that should share a lens have several."""
        return 0 < self.n_groups < self.n_lenses

    @property
    def distance(self) -> float:
        """Median over `pairs` of their distances in pixels; 0 without pairs."""
        return float(np.median([pair.distance for pair in self.pairs])) if self.pairs else 0.0

    @property
    def disagreeing(self) -> float:
        """Share of `pairs` that do not agree; 0 without pairs."""
        return sum(not pair.agrees for pair in self.pairs) / len(self.pairs) if self.pairs else 0.0


def measure_model(
    model: pycolmap.Reconstruction, trials: ModelTrials | None, *, should_stop: StopCheck
) -> dict[str, float | bool | int]:
    """Return the figures of `Evidence` that the model alone gives, by name.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        At least three placed photos. It is not changed.
    trials : ModelTrials or None
        Its trials, made here when None.

    Raises
    ------
    Cancelled
        When `should_stop` returned True.
    """
    figures: dict[str, float | bool | int] = {
        "n_lenses": len({model.image(i).camera_id for i in model.reg_image_ids()})
    }
    lengths = np.array([point.track.length() for point in model.points3D.values()])
    if len(lengths) == 0:
        return figures
    figures["seen_by_three"] = float((lengths >= 3).mean())
    figures["angle"] = _median_angle(model)
    figures["missing"] = missing_share(model)
    from .lens_groups import lenses_differ

    trials = trials or ModelTrials(tried_lenses(model, should_stop=should_stop))
    own = trials.own
    figures["lenses_differ"] = lenses_differ(model, own)
    if own.lenses:
        figures["own_gain"] = own.error / max(own.before, 1e-6)
    # One trial with all of it first: sound photos need no other. A trial that fails says nothing.
    everything = trials.with_everything(model, should_stop=should_stop)
    if everything.lenses and _gain(everything, own) > BETTER:
        return figures
    aspect = tried_lenses(model, with_aspect, should_stop=should_stop)
    if aspect.lenses:
        logs = np.log(aspect.aspects())
        # Half of the photos may be as they should be.
        figures["aspect"] = float(np.quantile(np.abs(logs), 0.75))
        if np.mean(np.sign(logs) == np.sign(np.median(logs))) >= _COMMON:
            figures["common_aspect"] = float(abs(np.median(logs)))
        figures["aspect_gain"] = _gain(aspect, own)
    shifted = tried_lenses(model, principal_point=True, should_stop=should_stop)
    if shifted.lenses:
        figures["shift"] = float(np.median(np.linalg.norm(shifted.center_shifts(), axis=1)))
        figures["shift_gain"] = _gain(shifted, own)
    figures["fisheye_gain"] = _gain(tried_lenses(model, _as_fisheye, should_stop=should_stop), own)
    return figures


def _gain(trial: LensTrial, own: LensTrial) -> float:
    """Return the error of `trial` relative to the best of the lenses as they are."""
    return trial.error / max(min(own.error, own.before), 1e-6) if trial.lenses else 1.0


def _as_fisheye(lens: pycolmap.Camera) -> pycolmap.Camera:
    params = [lens.mean_focal_length(), lens.principal_point_x, lens.principal_point_y, 0.0]
    return pycolmap.Camera(model=_FISHEYE, width=lens.width, height=lens.height, params=params)


def _median_angle(model: pycolmap.Reconstruction) -> float:
    """Return the median over the points of the largest angle between two of their rays, degrees."""
    centers = {image_id: model.image(image_id).projection_center() for image_id in model.reg_image_ids()}
    angles = []
    for point in model.points3D.values():
        rays = np.array([point.xyz - centers[element.image_id] for element in point.track.elements])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(np.arccos(np.clip((rays @ rays.T).min(), -1.0, 1.0)))
    return float(np.degrees(np.median(angles)))


def fit_of_pairs(model: pycolmap.Reconstruction, database: Path) -> tuple[PairFit, ...]:
    """Return how the strongest pairs of each photo agree with the cameras.

    Parameters
    ----------
    database : Path
        COLMAP's database with the verified matches.

    Returns
    -------
    tuple of PairFit
        For each placed photo its four pairs with the most verified matches, at least 30; no pair twice.
    """
    placed = set(model.reg_image_ids())
    with opened_database(database) as opened:
        pairs = verified_pairs(opened, _MIN_MATCHES)
        found = strongest_pairs((a, b, n) for a, b, n in pairs if a in placed and b in placed)
        keypoints: dict[int, Float64] = {}
        fits = []
        for a, b, _ in found:
            for image_id in (a, b):
                if image_id not in keypoints:
                    keypoints[image_id] = np.asarray(opened.read_keypoints(image_id))[:, :2].astype(np.float64)
            matches = opened.read_two_view_geometry(a, b).inlier_matches
            distances = epipolar_distances(model, a, b, keypoints[a][matches[:, 0]], keypoints[b][matches[:, 1]])
            fits.append(PairFit(a, b, float((distances <= _PIXELS).mean()), float(np.median(distances))))
    return tuple(fits)


def strong_links(model: pycolmap.Reconstruction, database: Path) -> int:
    """Return the number of pairs with at least 30 verified matches of which `model` places one photo."""
    placed = set(model.reg_image_ids())
    with opened_database(database) as opened:
        return sum((a in placed) != (b in placed) for a, b, _ in verified_pairs(opened, _MIN_MATCHES))


def strongest_pairs(pairs: Iterable[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Return of (first, second, matches) the four with the most matches of each photo, with at least 30."""
    partners: dict[int, list[tuple[int, int, int]]] = {}
    for a, b, n in pairs:
        if n >= _MIN_MATCHES:
            partners.setdefault(a, []).append((a, b, n))
            partners.setdefault(b, []).append((a, b, n))
    best = {
        pair for found in partners.values() for pair in sorted(found, key=lambda pair: (-pair[2], pair))[:_STRONGEST]
    }
    return sorted(best)


def epipolar_distances(model: pycolmap.Reconstruction, a: int, b: int, at_a: Float64, at_b: Float64) -> Float64:
    """Return the distances [M] of matches from their epipolar lines in pixels, by Sampson's approximation."""
    first, second = model.image(a).cam_from_world(), model.image(b).cam_from_world()
    lens_a, lens_b = lens_of(model, a), lens_of(model, b)
    essential = pycolmap.essential_matrix_from_pose(second * first.inverse())
    squared = pycolmap.compute_squared_sampson_error(lens_a.cam_from_img(at_a), lens_b.cam_from_img(at_b), essential)
    focal = 0.5 * (lens_a.mean_focal_length() + lens_b.mean_focal_length())
    # A point that a lens cannot see agrees with nothing.
    distances: Float64 = np.nan_to_num(np.sqrt(np.array(squared)), nan=np.inf) * focal
    return distances


def panorama_gain(database: Path, lenses: Mapping[int, pycolmap.Camera]) -> float:
    """Return how many more matches agree if the photos are taken for panoramas; 0 for photos of ordinary shape.

    Parameters
    ----------
    lenses : mapping of int to pycolmap.Camera
        Lens by image id.
    """
    aspects = [lens.width / lens.height for lens in lenses.values()]
    if not aspects or np.median(aspects) < _PANORAMA_ASPECT:
        return 0.0
    as_lenses = as_panoramas = 0
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    with opened_database(database) as opened:
        ids, counts = opened.read_num_matches()
        pairs = sorted(zip(counts, ids, strict=True), key=lambda one: (-one[0], one[1]))[:_PANORAMA_PAIRS]
        for _, pair_id in pairs:
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            if a not in lenses or b not in lenses:
                continue
            matches = opened.read_matches(a, b)
            points = [np.asarray(opened.read_keypoints(i))[:, :2].astype(np.float64) for i in (a, b)]
            ordinary = pycolmap.estimate_calibrated_two_view_geometry(
                lenses[a], points[0], lenses[b], points[1], matches, options
            )
            whole = [_whole_panorama(lenses[i], at) for i, at in zip((a, b), points, strict=True)]
            panoramic = pycolmap.estimate_calibrated_two_view_geometry(*whole[0], *whole[1], matches, options)
            as_lenses += len(ordinary.inlier_matches)
            as_panoramas += len(panoramic.inlier_matches)
    return as_panoramas / max(as_lenses, 1)


def _whole_panorama(lens: pycolmap.Camera, points: Float64) -> tuple[pycolmap.Camera, Float64]:
    """Return the camera of the 2:1 panorama that a picture shows the middle rows of, and its points there."""
    width, height = lens.width, lens.width // 2
    moved = points + (0.0, (height - lens.height) / 2)
    return pycolmap.Camera(model="EQUIRECTANGULAR", width=width, height=height, params=[width, height]), moved


def turned_share(database: Path) -> float:
    """Return the share of the strong verified pairs that a turn of the camera on one place explains.

    Between such photos the homography is ``K R K^-1``. Of a flat scene that is seen from several places it is not.
    """
    with opened_database(database) as opened:
        lenses = {lens.camera_id: lens for lens in opened.read_all_cameras()}
        size_of = {image.image_id: lenses[image.camera_id] for image in opened.read_all_images()}
        pair_ids, geometries = opened.read_two_view_geometries()
    strong = [
        (pycolmap.pair_id_to_image_pair(pair_id), one)
        for pair_id, one in zip(pair_ids, geometries, strict=True)
        if len(one.inlier_matches) >= _MIN_MATCHES
    ]
    turned = [
        int(one.config) in _BY_HOMOGRAPHY and one.H is not None and is_turn(one.H, size_of[a], size_of[b])
        for (a, b), one in strong
    ]
    return sum(turned) / len(turned) if turned else 0.0


def is_turn(H: Float64, first: pycolmap.Camera, second: pycolmap.Camera) -> bool:
    """Return whether a homography [3, 3] between pictures of two cameras is a turn, for any common focal length."""
    if not np.isfinite(H).all():
        return False
    centred = _centred(np.asarray(H), first, second)
    return min(_off_rotation(centred, focal) for focal in _FOCALS) <= _TURN


def _centred(H: Float64, first: pycolmap.Camera, second: pycolmap.Camera) -> Float64:
    """Return a homography of pixels for coordinates from the middle of the pictures, in their longest sides."""
    frames = []
    for lens in (first, second):
        side = max(lens.width, lens.height)
        frames.append(np.array([[side, 0.0, lens.width / 2], [0.0, side, lens.height / 2], [0.0, 0.0, 1.0]]))
    centred: Float64 = np.linalg.inv(frames[1]) @ H @ frames[0]
    return centred


def _off_rotation(H: Float64, focal: float) -> float:
    """Return how far ``K^-1 H K`` is from a rotation, as the largest departure of its singular values from 1."""
    K = np.diag([focal, focal, 1.0])
    turn = np.linalg.inv(K) @ H @ K
    scale = np.cbrt(abs(np.linalg.det(turn)))
    return float(np.abs(np.linalg.svd(turn / scale, compute_uv=False) - 1.0).max()) if scale > 0.0 else np.inf


def missing_share(model: pycolmap.Reconstruction) -> float:
    """Return the share of near views in which most points of the other photo were not found again.

    Two photos that look at the same points from nearly the same direction see the same things. Where a model lays
    parts on each other that only look alike, what stands around these parts is missing in one of the two.
    """
    seen: dict[int, set[int]] = {image_id: set() for image_id in model.reg_image_ids()}
    for point_id, point in model.points3D.items():
        for element in point.track.elements:
            seen[element.image_id].add(point_id)
    of_points = {
        image_id: (sorted(found), np.array([model.point3D(point_id).xyz for point_id in sorted(found)]))
        for image_id, found in seen.items()
        if len(found) >= _MIN_MATCHES
    }
    missing = near = 0
    centers = np.array([model.image(image_id).projection_center() for image_id in of_points]).reshape(-1, 3)
    for first, (point_ids, points) in of_points.items():
        rays = points - model.image(first).projection_center()
        lengths = np.linalg.norm(rays, axis=1)
        rays /= lengths[:, None]
        for second, is_near in zip(of_points, _nearly_along(points, rays, centers), strict=True):
            if first == second or not is_near:
                continue
            others = points - model.image(second).projection_center()
            cosine = (rays * others).sum(axis=1) / np.linalg.norm(others, axis=1)
            if np.median(cosine) < _NEAR_COSINE:
                continue
            inside = _is_in_picture(model, second, points)
            focals = [lens_of(model, image_id).mean_focal_length() for image_id in (first, second)]
            size = focals[1] * lengths / (focals[0] * np.linalg.norm(others, axis=1))
            if inside.mean() < 0.5 or not 1.0 / _SAME_SIZE < np.median(size) < _SAME_SIZE:
                continue
            near += 1
            again = np.fromiter((point_id in seen[second] for point_id in point_ids), bool, len(point_ids))
            missing += bool(again[inside].mean() < _FOUND_AGAIN)
    return missing / near if near >= _MIN_NEAR else 0.0


def _nearly_along(points: Float64, rays: Float64, centers: Float64) -> NDArray[np.bool_]:
    """Return for which centers [C, 3] the median cosine to the `rays` [P, 3] to the `points` [P, 3] may be near.

    All centers at a time, since their number grows with its square; a little less exact, so with a margin.
    """
    middle = points.mean(axis=0)
    points, centers = points - middle, centers - middle
    squared = (points**2).sum(axis=1)[:, None] - 2.0 * points @ centers.T + (centers**2).sum(axis=1)
    along = (rays * points).sum(axis=1)[:, None] - rays @ centers.T
    cosine = along / np.sqrt(np.maximum(squared, 1e-12))
    return np.asarray(np.median(cosine, axis=0) >= _NEAR_COSINE - 1e-6)


def _is_in_picture(model: pycolmap.Reconstruction, image_id: int, points: Float64) -> NDArray[np.bool_]:
    lens, pose = lens_of(model, image_id), model.image(image_id).cam_from_world().matrix()
    local = points @ pose[:, :3].T + pose[:, 3]
    front = local[:, 2] > 0
    inside = np.zeros(len(points), bool)
    pixels = np.asarray(lens.img_from_cam(local[front])).reshape(-1, 2)
    inside[front] = ((pixels >= 0) & (pixels < (lens.width, lens.height))).all(axis=1)
    return inside
