"""A 3D viewport in which photos are clicked through their cameras. Used by the modal operator `click_object`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import blf
import bpy
import numpy as np

from ...engine.core.errors import HeritageError, ObjectError
from ...engine.project.content import photo_camera
from ...engine.scene import Camera
from ...engine.workers.jobs import Click
from ..blender.world_placement import drawn_matrix, world_matrix
from ..splats.properties import project_of
from .backdrop import show_backdrop
from .cameras import current_photo, look_through
from .picking import View, photo_pixel, require_aligned
from .placement import scene_placement
from .scene_file import whole_scene

_MARK_SIZE = 24
_MARK_COLORS = {True: (0.3, 0.9, 0.3, 1.0), False: (1.0, 0.3, 0.2, 1.0)}
_MARKS = {True: "+", False: "\N{MINUS SIGN}"}


@dataclass
class Viewport:
    """A 3D viewport in which photos are clicked.

    Attributes
    ----------
    scene : Scene
    area : Area
        An area of type ``VIEW_3D``.
    photo_problem : str
        Why the current photo cannot be shown; empty when it is shown.
    """

    scene: bpy.types.Scene
    area: bpy.types.Area
    photo_problem: str = ""

    @classmethod
    def of(cls, context: bpy.types.Context) -> Viewport:
        """Return the viewport of `context`, set to look through the camera of a photo.

        Raises
        ------
        ObjectError
            When `context` is not a 3D viewport, or the scene has no camera of a photo.
        """
        if context.area is None or context.area.type != "VIEW_3D":
            raise ObjectError("Objects are clicked in a 3D viewport. Press the button in its sidebar (N).")
        viewport = cls(context.scene, context.area)
        viewport.show_photo(0)
        return viewport

    @property
    def _region(self) -> bpy.types.Region:
        return next(region for region in self.area.regions if region.type == "WINDOW")

    @property
    def _space(self) -> bpy.types.SpaceView3D:
        return self.area.spaces.active

    def show_photo(self, step: int) -> None:
        """Look through the camera that is `step` photos after the current one, and show its photo."""
        render = self.scene.render
        look_through(self.scene, "", max(render.resolution_x, render.resolution_y), step=step)
        self._space.region_3d.view_perspective = "CAMERA"
        project = self._project
        try:
            show_backdrop(self.scene, photo_camera(project, current_photo(self.scene)), project)
        except HeritageError as error:
            # Not fatal: the splats of the whole scene can be clicked as well.
            self.photo_problem = str(error)
            self.scene.heritage.show = "SCENE"
        else:
            self.photo_problem = ""

    @property
    def _project(self) -> Path:
        return project_of(self.scene.heritage)

    def click(self, x: int, y: int, wanted: bool) -> tuple[Click, tuple[float, float]]:
        """Return the pixel of the photo at the position (x, y) in the window, and its direction, used to draw a mark.

        Raises
        ------
        ObjectError
            When the viewport does not look through the camera of a photo.
        CameraError
            When the position is outside the photo, or the camera or the scene was moved.
        """
        camera = self._camera()
        region = self._region
        # + 0.5: the centre of the pixel.
        direction = self._view().direction(x - region.x + 0.5, y - region.y + 0.5)
        column, row = photo_pixel(camera, direction)
        return Click(camera.photo, column, row, wanted), direction

    def _camera(self) -> Camera:
        photo = current_photo(self.scene)
        if not photo or self._space.region_3d.view_perspective != "CAMERA":
            raise ObjectError("Look through the camera of a photo to click (Numpad 0, or the arrow keys).")
        camera, whole = photo_camera(self._project, photo), whole_scene(self.scene, self._project)
        if whole is not None:
            require_aligned(camera, world_matrix(self.scene.camera), scene_placement(whole))
        return camera

    def _view(self) -> View:
        return View(
            self._region.width,
            self._region.height,
            np.array(self._space.region_3d.perspective_matrix, np.float64),
            np.array(drawn_matrix(self.scene.camera), np.float64),
        )

    def frame(self) -> tuple[float, float, float, float] | None:
        """Return where the region shows the photo: left, bottom, right, top in pixels; None without a camera view."""
        if self._space.region_3d.view_perspective != "CAMERA" or self.scene.camera is None:
            return None
        corners = self.scene.camera.data.view_frame(scene=self.scene)
        view = self._view()
        # Blender looks along -Z, with Y up.
        spots = [view.region_position((x / -z, y / z)) for x, y, z in corners]
        return min(x for x, _ in spots), min(y for _, y in spots), max(x for x, _ in spots), max(y for _, y in spots)

    def draw_marks(self, marks: list[tuple[Click, tuple[float, float]]]) -> None:
        """Draw the clicks on the current photo. Blender calls this while it draws the viewport."""
        if self._space.region_3d.view_perspective != "CAMERA":
            return
        photo, view = current_photo(self.scene), self._view()
        blf.size(0, _MARK_SIZE)
        for click, direction in marks:
            if click.photo == photo:
                x, y = view.region_position(direction)
                width, height = blf.dimensions(0, _MARKS[click.wanted])
                blf.position(0, x - width / 2, y - height / 2, 0)
                blf.color(0, *_MARK_COLORS[click.wanted])
                blf.draw(0, _MARKS[click.wanted])
