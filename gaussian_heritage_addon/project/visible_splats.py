"""The splats of a scene that a viewport or a photo shows, as rays meet them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ...engine.core.errors import CameraError, ObjectError
from ...engine.core.files import path_within
from ...engine.project.content import photo_camera
from ...engine.rasterizer.settings import ALPHA_MIN
from ...engine.scene import Camera, PinholeCamera, RayCaster, photo_pixels, photo_ray, read_camera_set, similarity_scale
from ...engine.workers.jobs import Click
from ..blender.world_placement import world_matrix
from ..splats.properties import project_of, scene_count
from ..splats.selection import heritage_objects
from ..splats.sight import Seen, Sight, SplatLayer, seen_on_ray
from ..splats.splats import SplatScene
from .object_geometry import moved_gaussians
from .picking import FLIP
from .placement import frame_of_whole, scene_placement
from .scene_file import whole_scene

_MIN_FACING = 0.0
"""Smallest cosine between the directions from which a viewport and a photo look at a point."""
_DEPTH_TOLERANCE = 0.03
"""A photo shows a point when the surface on its ray is at most this share of the distance nearer."""


@dataclass(frozen=True)
class PhotoSight:
    """The view of a photo; it takes the place of `Sight` in scripts, which have no viewport.

    Attributes
    ----------
    camera : Camera
        With its lens distortion. Positions are pixels of the photo, from its upper left corner.
    world_from_scene : array of shape [4, 4], float64
        Placement of the whole scene, which can be inverted.
    """

    camera: Camera
    world_from_scene: Float64

    def ray(self, x: float, y: float) -> tuple[Float64, Float64]:
        """Return origin and unit direction of the ray through a pixel, in Blender's world."""
        origin, direction = photo_ray(self.camera, x, y)
        moved = self.world_from_scene[:3, :3] @ direction
        return self.world_from_scene[:3, :3] @ origin + self.world_from_scene[:3, 3], moved / np.linalg.norm(moved)

    def positions(self, points: NDArray[np.floating]) -> Float64:
        """Return the pixels [N, 2] of points [N, 3] of Blender's world; NaN behind the camera."""
        viewmat = self.camera.viewmat @ np.linalg.inv(self.world_from_scene)
        local = points.astype(np.float64) @ viewmat[:3, :3].T + viewmat[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            directions = np.where(local[:, 2:] > 0, local[:, :2] / local[:, 2:], np.nan)
        return photo_pixels(self.camera, directions)


def sight_of_viewport(region: bpy.types.Region, view: bpy.types.RegionView3D) -> Sight:
    """Return what a region of a 3D viewport shows."""
    return Sight(region.width, region.height, np.array(view.perspective_matrix, np.float64))


def viewport_camera(context: bpy.types.Context) -> PinholeCamera | None:
    """Return where the user looks from, in the normalised world; None without a 3D viewport or without the scene."""
    area = context.area
    whole = whole_scene(context.scene, project_of(context.scene.heritage))
    if area is None or area.type != "VIEW_3D" or whole is None:
        return None
    region = next(one for one in area.regions if one.type == "WINDOW")
    view = area.spaces.active.region_3d
    viewmat = FLIP @ np.array(view.view_matrix, np.float64) @ world_matrix(whole) @ frame_of_whole(whole)
    size = similarity_scale(viewmat)
    if not (np.isfinite(size) and size > 0):
        return None
    viewmat[:3] /= size
    # The nearest rotation: the matrices of Blender are float32.
    left, _, right = np.linalg.svd(viewmat[:3, :3])
    viewmat[:3, :3] = left @ right
    lens = np.array(view.window_matrix, np.float64)
    focal = abs(lens[0, 0]) * region.width / 2, abs(lens[1, 1]) * region.height / 2
    K = np.array([[focal[0], 0, region.width / 2], [0, focal[1], region.height / 2], [0, 0, 1.0]])
    return PinholeCamera(viewmat, K, region.width, region.height)


def sight_of_photo(scene: bpy.types.Scene, photo: str) -> PhotoSight:
    """Return what the photo `photo` of the project shows.

    Raises
    ------
    HeritageError
        When there is no such photo, or the scene was not imported, or is flattened.
    """
    return PhotoSight(photo_camera(project_of(scene.heritage), photo), scene_placement(_whole(scene)))


def _whole(scene: bpy.types.Scene) -> bpy.types.Object:
    whole = whole_scene(scene, project_of(scene.heritage))
    if whole is None:
        raise ObjectError("The whole scene is not in this file. Open the project again.")
    return whole


@dataclass(frozen=True)
class SplatsInView:
    """The splats of a scene that are shown.

    Attributes
    ----------
    layers : tuple of SplatLayer
    names : tuple of str
        Names of the isolated objects that the labels of the layers mean.
    """

    layers: tuple[SplatLayer, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, scene: bpy.types.Scene, *, only: Sequence[str] | None = None) -> SplatsInView:
        """Return the splats that `scene` shows, by default; or those of the objects `only`, shown or not.

        Raises
        ------
        ObjectError
            When a splat object was changed by another program.
        """
        objects = heritage_objects(scene)
        shown = [obj for obj in objects if (obj.visible_get() if only is None else obj.name in only)]
        isolated = [obj for obj in objects if obj.heritage.role == "OBJECT"]
        names = tuple(obj.name for obj in isolated)
        return cls(tuple(_layer(obj, isolated, names) for obj in shown), names)

    def seen(self, origin: Float64, direction: Float64) -> Seen:
        """Return what a ray of Blender's world, as of `seen_on_ray`, meets; `Seen.label` is an index into `names`."""
        return seen_on_ray(self.layers, origin, direction)

    def name_of(self, seen: Seen) -> str:
        """Return the name of the isolated object that a ray meets; empty for none."""
        return self.names[seen.label] if seen.label >= 0 else ""


def _layer(obj: bpy.types.Object, isolated: Sequence[bpy.types.Object], names: Sequence[str]) -> SplatLayer:
    splats = SplatScene.of(obj)
    gaussians = splats.local_gaussians(harmonics=False)
    shown = gaussians.opacities > ALPHA_MIN
    labels = np.full(len(gaussians), -1, np.int32)
    if obj.heritage.role == "OBJECT":
        labels[:] = names.index(obj.name)
        shown &= splats.shown
    else:
        labels = _labels_of_scene(obj, splats, isolated, names)
    vertices = np.flatnonzero(shown)
    return SplatLayer(obj.name, RayCaster(gaussians[vertices]), world_matrix(obj), labels[vertices], vertices)


def _labels_of_scene(
    whole: bpy.types.Object, splats: SplatScene, isolated: Sequence[bpy.types.Object], names: Sequence[str]
) -> NDArray[np.int32]:
    """Return for each Gaussian of the whole scene the isolated object that it belongs to most; -1 for none."""
    count = scene_count(whole)
    best, owner = np.zeros(count, np.float32), np.full(count, -1, np.int32)
    for obj in isolated:
        if project_of(obj.heritage) != project_of(whole.heritage) or obj.heritage.kind == "background":
            continue
        one = SplatScene.of(obj)
        rows, membership = one.index(count), one.membership
        if membership is None:
            continue
        own = (rows >= 0) & (membership >= np.float32(obj.heritage.threshold))
        rows, membership = rows[own], membership[own]
        stronger = membership > best[rows]
        best[rows[stronger]] = membership[stronger]
        owner[rows[stronger]] = names.index(obj.name)
    index = splats.index(count)
    return np.where(index >= 0, owner[index], -1)


def photo_of_point(scene: bpy.types.Scene, cameras: Sequence[Camera], point: Float64, direction: Float64) -> Click:
    """Return the pixel of the photo that shows a point best, to isolate an object by it.

    Parameters
    ----------
    cameras : sequence of Camera
        Of the project.
    point, direction : arrays of shape [3]
        Surface that was picked, and the direction in which the eye looks, in Blender's world.

    Raises
    ------
    CameraError
        When no photo shows the point from this side.
    ObjectError
        When the whole scene was not imported, or is flattened.
    """
    whole = _whole(scene)
    inverse = np.linalg.inv(scene_placement(whole))
    caster = RayCaster(
        moved_gaussians(SplatScene.of(whole).local_gaussians(harmonics=False), np.linalg.inv(frame_of_whole(whole)))
    )
    local, look = inverse[:3, :3] @ point + inverse[:3, 3], inverse[:3, :3] @ direction
    look /= np.linalg.norm(look)

    def facing(camera: Camera) -> float:
        to_point = local - camera.center
        return float(to_point @ look / max(float(np.linalg.norm(to_point)), 1e-12))

    for camera in sorted(cameras, key=facing, reverse=True):
        if facing(camera) <= _MIN_FACING:
            break
        x, y = PhotoSight(camera, np.eye(4)).positions(local[None])[0]
        if not (0 <= x < camera.width and 0 <= y < camera.height):
            continue
        to_point = local - camera.center
        surface = caster.cast(camera.center, to_point).surface
        if surface is not None and surface >= np.linalg.norm(to_point) * (1 - _DEPTH_TOLERANCE):
            return Click(camera.photo, round(float(x), 2), round(float(y), 2))
    raise CameraError("No photo shows this place from this side. Turn the view, or click on a photo instead.")


def cameras_of(scene: bpy.types.Scene) -> tuple[Camera, ...]:
    """Return the cameras of the photos of the project of `scene`; raises `FormatError` when they cannot be read."""
    return read_camera_set(path_within(project_of(scene.heritage), "cameras")).cameras
