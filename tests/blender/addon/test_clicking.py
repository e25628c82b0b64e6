"""Clicks through the camera of a photo become pixels of that photo, and arguments of the engine."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part

LENS = (170.0, 160.0, 68.0, 44.0, -0.15, 0.04, 0.006, -0.009)


@pytest.fixture
def camera(camera: Any, part: Part) -> Any:
    """Return the oblique camera with lens distortion."""
    return part("engine.scene.camera").Camera(camera.photo, 128, 96, "OPENCV", LENS, camera.viewmat)


def pixels(camera: Any, points: np.ndarray) -> np.ndarray:
    """Return the pixels of world points in the photo, with Brown's lens model written out."""
    fx, fy, cx, cy, k1, k2, p1, p2 = camera.params
    x, y, z = (points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]).T
    u, v = x / z, y / z
    square = u * u + v * v
    radial = 1 + k1 * square + k2 * square**2
    du = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
    dv = v * radial + p1 * (square + 2 * v * v) + 2 * p2 * u * v
    return np.stack([fx * du + cx, fy * dv + cy], axis=1)


class Window:
    """Fake 3D viewport of 640x400 at (50, 30), with a sidebar over its right edge and the view of the scene camera."""

    x, y, width, height = 50, 30, 640, 400

    def __init__(self, zoom: float = 0.5, shift: tuple[float, float] = (0.0, 0.0)) -> None:
        self.region = SimpleNamespace(x=self.x, y=self.y, width=self.width, height=self.height, type="WINDOW")
        sidebar = SimpleNamespace(x=590, y=30, width=100, height=400, type="UI")
        closed = SimpleNamespace(x=50, y=30, width=1, height=400, type="TOOLS")
        self.region_3d = SimpleNamespace(view_perspective="PERSP", perspective_matrix=None)
        spaces = SimpleNamespace(active=SimpleNamespace(region_3d=self.region_3d))
        self.area = SimpleNamespace(
            type="VIEW_3D", regions=[sidebar, closed, self.region], spaces=spaces, tag_redraw=lambda: None
        )
        self.header = ""
        self.area.header_text_set = lambda text: setattr(self, "header", text)
        self._zoom, self._shift = zoom, shift

    def update_matrix(self) -> None:
        """Update the matrix, as Blender does when it draws."""
        scene = bpy.context.scene
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        lens = np.array(scene.camera.calc_matrix_camera(depsgraph, x=self.width, y=self.height))
        moved = np.diag([self._zoom, self._zoom, 1.0, 1.0])
        moved[:2, 3] = self._shift
        self.region_3d.perspective_matrix = moved @ lens @ np.array(scene.camera.matrix_world.inverted())

    def position(self, point: np.ndarray) -> tuple[float, float]:
        """Return the position of a world point in the window."""
        x, y, _, w = self.region_3d.perspective_matrix @ [*point, 1.0]
        return self.x + (x / w + 1) * self.width / 2, self.y + (y / w + 1) * self.height / 2


@pytest.mark.parametrize(("zoom", "shift"), [(1.0, (0.0, 0.0)), (0.5, (0.3, -0.2)), (2.0, (-0.4, 0.1))])
@pytest.mark.parametrize("resolution", [(128, 96), (640, 640)])
def test_click_is_the_pixel_of_the_photo_however_the_view_is_zoomed(
    opened: Any, camera: Any, part: Part, zoom: float, shift: tuple[float, float], resolution: tuple[int, int]
) -> None:
    window = Window(zoom, shift)
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(bpy.context.scene, window.area)
    viewport.show_photo(0)
    assert window.region_3d.view_perspective == "CAMERA"
    # The resolution of renders must not matter.
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = resolution
    window.update_matrix()
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (40, 3))
    expected = pixels(camera, points)
    inside = (expected > 0).all(axis=1) & (expected < (camera.width, camera.height)).all(axis=1)
    assert inside.sum() > 10
    for point, pixel in zip(points[inside], expected[inside], strict=True):
        x, y = window.position(point)
        # A click is at the centre of a pixel of the window, hence the 0.5.
        click, direction = viewport.click(x - 0.5, y - 0.5, True)
        assert click.photo == camera.photo
        # Pixels are rounded to a hundredth, and Blender's matrices are float32.
        np.testing.assert_allclose((click.x, click.y), pixel, atol=0.02)


def test_other_view_or_moved_camera_is_a_clear_error(opened: Any, part: Part) -> None:
    errors, window = part("engine.core.errors"), Window()
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(bpy.context.scene, window.area)
    viewport.show_photo(0)
    window.update_matrix()
    viewport.click(370, 230, True)
    with pytest.raises(errors.CameraError, match="outside the photo"):
        viewport.click(51, 31, True)
    window.region_3d.view_perspective = "PERSP"
    with pytest.raises(errors.ObjectError, match="Look through the camera of a photo"):
        viewport.click(370, 230, True)
    viewport.show_photo(0)
    bpy.context.scene.camera.location.x += 0.1
    window.update_matrix()
    with pytest.raises(errors.CameraError, match="no longer lines up with the scene"):
        viewport.click(370, 230, True)


def save_photo(part: Part, project: Path, name: str, orientation: int) -> None:
    """Save a photo of 1024x768 with x in red and y in green, rotated according to the EXIF `orientation`."""
    y, x = np.mgrid[:768, :1024]
    upright = np.stack([(x + 0.5) / 1024, (y + 0.5) / 768, 0 * x, 0 * x + 1], axis=-1).astype(np.float32)
    stored = np.ascontiguousarray(upright if orientation == 1 else upright[:, ::-1].swapaxes(0, 1))
    image = bpy.data.images.new("stored", stored.shape[1], stored.shape[0])
    image.pixels.foreach_set(np.ascontiguousarray(stored[::-1]).ravel())
    folder = project.parent / "photos"
    file = folder / name
    file.parent.mkdir(parents=True)
    bpy.context.scene.render.image_settings.quality = 100
    image.filepath_raw, image.file_format = str(file), "JPEG"
    image.save(quality=100)
    bpy.data.images.remove(image)
    tag = b"\x12\x01\x03\x00\x01\x00\x00\x00" + bytes([orientation]) + b"\x00\x00\x00"
    exif = b"Exif\0\0II*\0\x08\x00\x00\x00\x01\x00" + tag + b"\x00\x00\x00\x00"
    data = file.read_bytes()
    file.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])
    photo = part("engine.scene.photo")
    photos = photo.PhotoSet(folder, (photo.Photo(name, 1024, 768, None, "0"),), ())
    part("engine.scene.photo_storage").write_photo_set(project / "photos" / "photos.json", photos)


@pytest.mark.parametrize("orientation", [1, 6])
def test_photo_is_aligned_with_the_splats(opened: Any, camera: Any, part: Part, orientation: int) -> None:
    save_photo(part, opened.folder, camera.photo, orientation)
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(bpy.context.scene, Window().area)
    viewport.show_photo(0)
    assert viewport.photo_problem == ""
    scene = bpy.context.scene
    (entry,) = scene.camera.data.background_images
    assert scene.camera.data.show_background_images and (entry.frame_method, entry.alpha) == ("STRETCH", 1.0)
    width, height = entry.image.size
    assert (width, height) == (1024, 768)
    pixels_of_image = np.empty(width * height * 4, np.float32)
    entry.image.pixels.foreach_get(pixels_of_image)
    shown = pixels_of_image.reshape(height, width, 4)[::-1]
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (300, 3))
    local = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    fx, fy, cx, cy = camera.params[:4]
    pinhole = local[:, :2] / local[:, 2:] * (fx, fy) + (cx, cy)
    expected = pixels(camera, points)
    inside = ((pinhole > 1) & (pinhole < (127, 95)) & (expected > 1) & (expected < (127, 95))).all(axis=1)
    assert inside.sum() > 50 and np.abs(pinhole - expected)[inside].max() > 1.5
    columns, rows = (pinhole[inside] * 8).astype(int).T
    seen = shown[rows, columns, :2] * (128, 96)
    # 8 bits resolve 0.25 pixels here, and JPEG adds to it: worst error seen 0.9, mean 0.2.
    errors = np.linalg.norm(seen - expected[inside], axis=1)
    bent = np.linalg.norm(pinhole - expected, axis=1)[inside] > 1.0
    assert bent.sum() >= 5 and errors[bent].mean() < 0.5 and errors.max() < 1.3
    # Splats that are drawn over the photo fade instead of the photo.
    scene.heritage.photo_opacity = 0.25
    assert entry.alpha == 1.0
    scene.heritage_display.kind = "SHAPES"
    assert entry.alpha == 0.25
    scene.heritage_display.kind, scene.heritage.photo_opacity = "SPLATS", 0.0
    assert entry.alpha == 0.0
    viewport.show_photo(0)
    assert len(scene.camera.data.background_images) == 1


def test_missing_photo_does_not_prevent_clicking(opened: Any, camera: Any, part: Part) -> None:
    window = Window()
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(bpy.context.scene, window.area)
    viewport.show_photo(0)
    assert "photos.json cannot be read" in viewport.photo_problem
    bpy.context.scene.heritage.show = "OBJECTS"
    save_photo(part, opened.folder, camera.photo, 1)
    file = opened.folder.parent / "photos" / camera.photo
    file.write_bytes(b"not a photo")
    viewport.show_photo(0)
    assert "Blender cannot read" in viewport.photo_problem
    file.unlink()
    viewport.show_photo(0)
    assert "is missing" in viewport.photo_problem
    # In place of the photo, there is the scene to click on, and not only its objects.
    assert bpy.context.scene.heritage.show == "SCENE"
    window.update_matrix()
    assert viewport.click(370, 230, True)[0].photo == camera.photo


def test_photos_are_visited_in_order(opened: Any, part: Part, camera: Any) -> None:
    cameras, scene = part("gaussian_heritage_addon.project.cameras"), bpy.context.scene
    others = [part("engine.scene.camera").Camera(name, 64, 48, "PINHOLE", LENS[:4], camera.viewmat) for name in "zy"]
    cameras.add_cameras(others, scene.collection)
    scene.render.resolution_x, scene.render.resolution_y = 100, 100
    viewport = part("gaussian_heritage_addon.project.clicking").Viewport(scene, Window().area)
    viewport.show_photo(0)
    # Clicking keeps the longest side of renders.
    assert (cameras.current_photo(scene), scene.render.resolution_x, scene.render.resolution_y) == (
        camera.photo,
        100,
        75,
    )
    seen = []
    for step in (1, 1, 1, -1):
        bpy.ops.heritage.look_through_photo(step=step)
        seen.append((cameras.current_photo(scene), scene.render.resolution_x))
    assert seen == [("y", 64), ("z", 64), (camera.photo, 128), ("z", 64)]


class Tool:
    """A modal operator as Blender runs it, without a window: ``invoke()`` it, then send it events with ``event(...)``.

    It is a class with the same functions, because only Blender can create instances of operators.
    """

    def __init__(self, operator: type, window: Window, **options: Any) -> None:
        functions: dict[str, Any] = {}
        package = operator.__module__.partition(".operators")[0]
        for base in [one for one in reversed(operator.__mro__) if one.__module__.startswith(package)]:
            functions |= {name: one for name, one in vars(base).items() if isinstance(one, FunctionType | property)}
        self.window, self.messages, self.handlers = window, list[str](), list[Any]()
        told = self.messages
        given = {"_session": None, "report": lambda self, kind, text: told.append(text)}
        known = {name: getattr(operator, name) for name in ("n_clicks", "help_text") if hasattr(operator, name)}
        self.operator = type("FakeOperator", (), {**functions, **given, **known, **options})()
        windows = [SimpleNamespace(screen=SimpleNamespace(areas=[window.area]))]
        self.context = SimpleNamespace(
            scene=bpy.context.scene,
            area=window.area,
            window_manager=SimpleNamespace(modal_handler_add=self.handlers.append, windows=windows),
        )

    def window_frame(self) -> Any:
        """Return the frame of the photo in the view."""
        return self.operator._viewport.frame()

    def invoke(self, **options: Any) -> set[str]:
        for name, value in options.items():
            setattr(self.operator, name, value)
        result: set[str] = self.operator.invoke(self.context, None)
        self.window.update_matrix()
        return result

    def event(
        self, kind: str, at: tuple[int, int] = (370, 230), *, shift: bool = False, ctrl: bool = False, value: str = ""
    ) -> set[str]:
        moves = value or ("NOTHING" if kind == "MOUSEMOVE" else "PRESS")
        window_event = SimpleNamespace(type=kind, value=moves, mouse_x=at[0], mouse_y=at[1], shift=shift, ctrl=ctrl)
        result: set[str] = self.operator.modal(self.context, window_event)
        return result


@pytest.fixture
def clicking(opened: Any, part: Part) -> Tool:
    """The operator *Click Object*, with the project open."""
    return Tool(part("operators.click_object").HERITAGE_OT_click_object, Window(), refine=False)


FOUND = """
project = Path(sys.argv[4])
write_object(project, "object", "object", np.r_[np.zeros(90), np.ones(10)].astype(np.float32))
say("finished", message="Isolated object (0.80).", outputs={"objects": ["object"]})
"""


def test_clicks_and_enter_isolate_a_new_object(clicking: Any, fake_engine: Callable[[str], Path]) -> None:
    arguments = fake_engine(FOUND)
    assert clicking.invoke() == {"RUNNING_MODAL"} and len(clicking.handlers) == 1
    assert clicking.event("MIDDLEMOUSE") == {"PASS_THROUGH"}
    assert clicking.event("LEFTMOUSE", (620, 230)) == {"PASS_THROUGH"}
    assert clicking.event("LEFTMOUSE") == {"RUNNING_MODAL"}
    clicking.event("LEFTMOUSE", (380, 230), shift=True)
    clicking.event("LEFTMOUSE", (350, 210), ctrl=True)
    clicking.event("LEFTMOUSE", (390, 250))
    assert "2 on the object, 2 beside it" in clicking.window.header
    clicking.event("BACK_SPACE")
    clicking.event("LEFTMOUSE", (51, 31))
    assert "outside the photo" in clicking.messages[-1]
    assert clicking.event("RET") == {"FINISHED"}
    assert clicking.window.header is None
    words = json.loads(arguments.read_text(encoding="utf-8"))[4:-1]
    options = [word.partition("=")[0] for word in words]
    assert options == ["--click", "--not", "--not"]
    assert all(word.partition("=")[2].startswith("a b/view 1.jpg=") for word in words)
    assert "object" in bpy.data.collections


def test_clicks_correct_the_selected_object(clicking: Any, fake_engine: Callable[[str], Path]) -> None:
    arguments = fake_engine("say('finished', outputs={'objects': ['vase']})")
    bpy.context.scene.heritage.active = -1
    assert clicking.invoke(refine=True) == {"CANCELLED"}
    assert clicking.messages == ["Select an isolated object in the list first."]
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    assert clicking.invoke(refine=True) == {"RUNNING_MODAL"}
    clicking.event("LEFTMOUSE", shift=True)
    # It is the object that was selected when the button was pressed.
    bpy.context.scene.heritage.active = -1
    assert clicking.event("NUMPAD_ENTER") == {"FINISHED"}
    refine, click = json.loads(arguments.read_text(encoding="utf-8"))[4:6]
    assert refine == "--refine=vase" and click.startswith("--not=a b/view 1.jpg=")


def test_escape_starts_nothing_and_an_error_is_reported(clicking: Any, fake_engine: Callable[[str], Path]) -> None:
    arguments = fake_engine(FOUND)
    clicking.invoke()
    clicking.event("LEFTMOUSE")
    assert clicking.event("ESC") == {"CANCELLED"}
    clicking.invoke()
    clicking.event("LEFTMOUSE", shift=True)
    assert clicking.event("RET") == {"CANCELLED"}
    assert "Click the object at least once" in clicking.messages[-1] and not arguments.exists()


def test_without_a_window_the_error_is_clear(opened: Any) -> None:
    with pytest.raises(RuntimeError, match="Objects are clicked in a window"):
        bpy.ops.heritage.click_object()


ANSWERS = """
for line in sys.stdin:
    asked = json.loads(line)
    width = 128
    bits = np.zeros((96, width), bool)
    bits[:, :64] = True
    import base64
    mask = {"width": width, "height": 96, "bits": base64.b64encode(np.packbits(bits).tobytes()).decode()}
    name = "present" if asked["object"] else "wanted"
    say("finished", message="", outputs={"photo": asked["photo"], "masks": {name: mask}})
"""


@pytest.fixture
def windowed(part: Part, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Let the masks of clicks be shown as in a window, with an engine that answers."""
    module = part("gaussian_heritage_addon.jobs.click_masks")
    monkeypatch.setattr(module, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), types=bpy.types))
    # Timers do not run in bpy as a module, and one that is left hangs at its exit.
    monkeypatch.setattr(module, "_timer", SimpleNamespace(start=lambda seconds: None, stop=lambda: None))
    return module


def wait_for_masks(module: ModuleType) -> Any:
    masks = module._active
    while masks._process.is_working:
        masks.poll()
        time.sleep(0.02)
    return masks


def test_click_shows_its_mask_before_enter(
    clicking: Any, windowed: ModuleType, fake_engine: Callable[[str], Path], camera: Any
) -> None:
    arguments = fake_engine(ANSWERS)
    clicking.invoke()
    clicking.event("LEFTMOUSE")
    assert "are being prepared" in clicking.window.header
    masks = wait_for_masks(windowed)
    assert json.loads(arguments.read_text(encoding="utf-8"))[2:4] == ["show-clicks", bpy.context.scene.heritage.project]
    assert "are being prepared" not in clicking.window.header
    # The left half of the photo, but for its lens distortion, in the colour of what is wanted.
    assert masks._photo == camera.photo
    green = masks._picture[..., 1] > masks._picture[..., 0]
    assert green[48, 10:40].all() and not green[48, 90:].any()
    left, bottom, right, top = clicking.window_frame()
    assert 0 < right - left <= clicking.window.width and 0 < top - bottom <= clicking.window.height
    # Without a click there is nothing to show.
    clicking.event("BACK_SPACE")
    assert not masks._picture.any()
    clicking.event("ESC")
    assert windowed._active is None and masks._process is None


def test_correction_begins_with_what_the_object_has(
    clicking: Any, windowed: ModuleType, fake_engine: Callable[[str], Path]
) -> None:
    fake_engine(ANSWERS)
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    clicking.invoke(refine=True)
    masks = wait_for_masks(windowed)
    blue = masks._picture[..., 2] > masks._picture[..., 0]
    assert blue[48, 10:40].all() and not blue[48, 90:].any()
    clicking.event("ESC")


def test_engine_that_cannot_show_masks_says_why_and_clicking_goes_on(
    clicking: Any, windowed: ModuleType, fake_engine: Callable[[str], Path]
) -> None:
    fake_engine("say('error', message='The scene is damaged.', error='FormatError'); sys.exit(1)")
    clicking.invoke()
    clicking.event("LEFTMOUSE")
    masks = windowed._active
    while not masks.problem:
        masks.poll()
        time.sleep(0.02)
    assert "The scene is damaged." in clicking.window.header
    assert clicking.event("ESC") == {"CANCELLED"}
