"""Masks over the photo that is clicked: what the clicks mean, and what an object that is corrected has now."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import bpy
import gpu
import numpy as np
from bpy.app.translations import pgettext_n
from gpu_extras.presets import draw_texture_2d
from numpy.typing import NDArray

from ...engine.core.errors import HeritageError
from ...engine.project.content import photo_camera
from ...engine.workers.jobs import Click, ClickAnswer, ClickPreview, click_question
from ..blender.guards import Timer
from ..project.cameras import current_photo
from ..project.clicking import Viewport
from ..project.photo_frame import remove_distortion
from ..setup.engine_process import engine_command
from ..setup.preferences import current_environment, current_python, sam_arguments
from ..splats.properties import project_of

_INTERVAL = 0.03
"""Seconds between two looks for an answer."""
_COLORS = {
    "present": (0.25, 0.55, 1.0, 0.35),
    "wanted": (0.25, 0.9, 0.35, 0.5),
    "unwanted": (1.0, 0.3, 0.2, 0.5),
}
"""Colour of each mask, with its opacity; later ones lie over earlier ones."""
_PREPARING = pgettext_n("The masks of clicks are being prepared ...")

_active: ClickMasks | None = None


def colored(masks: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.float32]:
    """Return masks of the same size, bool [H, W], as one picture with premultiplied alpha, float32 [H, W, 4]."""
    picture: NDArray[np.float32] | None = None
    for name, color in _COLORS.items():
        if name in masks:
            if picture is None:
                picture = np.zeros((*masks[name].shape, 4), np.float32)
            picture[masks[name]] = [*(value * color[3] for value in color[:3]), color[3]]
    return np.zeros((1, 1, 4), np.float32) if picture is None else picture


class ClickMasks:
    """The masks of one session of clicks, from an engine process of its own.

    Parameters
    ----------
    object_id : str
        Object that is corrected; empty for a new one.
    changed : callable
        Called when there is something new to draw or to say.
    """

    def __init__(self, viewport: Viewport, object_id: str, changed: Callable[[], None]) -> None:
        self._viewport, self._object_id, self._changed = viewport, object_id, changed
        self._process: ClickPreview | None = None
        self._texture: gpu.types.GPUTexture | None = None
        self._photo, self._picture = "", colored({})
        self._is_ready = False
        self.problem = ""

    def start(self) -> None:
        """Start the engine, which takes some seconds; nothing in background mode, where nothing is drawn."""
        global _active
        if bpy.app.background:
            return
        project = str(project_of(self._viewport.scene.heritage))
        try:
            command = engine_command(current_python(), "show-clicks", project, *sam_arguments())
        except HeritageError as error:
            # Objects can be clicked without seeing masks; Enter says what is wrong with the engine.
            self.problem = str(error)
            return
        self._process = ClickPreview(command, current_environment())
        _active = self
        _timer.start(_INTERVAL)

    def ask(self, clicks: Sequence[Click]) -> None:
        """Ask for the masks of these clicks on the photo that is shown; the former ones are no longer drawn."""
        if current_photo(self._viewport.scene) != self._photo:
            self._show(colored({}), "")
        if self._process is not None and (clicks or self._object_id):
            self._process.ask(click_question(current_photo(self._viewport.scene), clicks, self._object_id))
        else:
            self._show(colored({}), "")

    def poll(self) -> None:
        """Take an answer that has arrived."""
        answer = None if self._process is None else self._process.poll()
        if answer is not None:
            self._take(answer)
            self._changed()

    def status(self) -> str:
        """Return what the header says of the masks; empty when they are shown, or none are asked for."""
        if self.problem:
            return self.problem
        is_late = self._process is not None and self._process.is_working and not self._is_ready
        return _PREPARING if is_late else ""

    def close(self) -> None:
        """End the engine process and draw nothing any more."""
        global _active
        if self._process is not None:
            self._process.close()
        self._process = self._texture = None
        if _active is self:
            _active = None
            _timer.stop()

    def draw(self) -> None:
        """Draw the masks over the photo. Blender calls this while it draws the viewport."""
        frame = self._viewport.frame()
        if frame is None or current_photo(self._viewport.scene) != self._photo or not self._picture.any():
            return
        if self._texture is None:
            height, width = self._picture.shape[:2]
            # Blender's textures begin with the bottom row.
            values = gpu.types.Buffer("FLOAT", self._picture.size, np.ascontiguousarray(self._picture[::-1]).ravel())
            self._texture = gpu.types.GPUTexture((width, height), format="RGBA32F", data=values)
        left, bottom, right, top = frame
        gpu.state.blend_set("ALPHA_PREMULT")
        draw_texture_2d(self._texture, (left, bottom), right - left, top - bottom)
        gpu.state.blend_set("NONE")

    def _take(self, answer: ClickAnswer) -> None:
        self._is_ready, self.problem = True, answer.problem
        if answer.problem:
            self._show(colored({}), "")
            return
        camera = photo_camera(project_of(self._viewport.scene.heritage), answer.photo)
        # Blender's camera has no lens distortion.
        self._show(remove_distortion(colored(answer.masks), camera), answer.photo)

    def _show(self, picture: NDArray[np.float32], photo: str) -> None:
        self._picture, self._photo, self._texture = picture, photo, None


def _poll() -> float | None:
    if _active is None:
        return None
    _active.poll()
    return _INTERVAL


_timer = Timer(_poll)
