"""Exported files in other viewers, in Chromium with software WebGL: upright, framed, and like our own pictures."""

from __future__ import annotations

import base64
import functools
import http.server
import io
import json
import shutil
import threading
import urllib.parse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser
from playwright.sync_api import TimeoutError as PageTimeout

from benchmarks.camera_health.box_room import looking_along
from benchmarks.pictures import psnr, read_picture
from benchmarks.serve.page import chromium
from engine.core.errors import EnvironmentProblem
from engine.formats import read_glb, read_ply
from engine.pictures import Scene
from engine.scene import PinholeCamera, read_camera_set

HERE = Path(__file__).resolve().parent
WIDTH, HEIGHT = 640, 480
FOV = 50.0
"""Vertical field of view in degrees."""
N_VIEWS = 3
MAX_SECONDS = 180
Point = NDArray[np.float64]


@dataclass(frozen=True)
class Viewer:
    """A viewer: the place of a point of the engine's world in it, and the address of a page that shows a file."""

    name: str
    suffixes: tuple[str, ...]
    place: Callable[[Point, str], Point]
    address: Callable[[str, tuple[Point, Point] | None, Path], str]


@dataclass(frozen=True)
class Shown:
    """What a viewer showed of a file.

    Attributes
    ----------
    viewer, file : str
    psnr : tuple of float
        Beside the engine's pictures from the same cameras, dB.
    psnr_upside_down : float
        The mean beside the engine's pictures turned by 180 degrees: far lower when the file is upright.
    framed : Framed
        In the viewer's own framing.
    """

    viewer: str
    file: str
    psnr: tuple[float, ...]
    psnr_upside_down: float
    framed: Framed


@dataclass(frozen=True)
class Framed:
    """How a viewer frames a file by itself.

    Attributes
    ----------
    covered : float
        Share of the picture that shows something.
    extent : float
        Largest side of what is shown, as a share of that side of the picture; 1 where it reaches two opposite edges.
    """

    covered: float
    extent: float

    @classmethod
    def of(cls, picture: NDArray[np.float64]) -> Framed:
        """Return how much of a picture, [H, W, 3] with a black background, is shown."""
        lit = picture.max(axis=2) > 0.05
        sides = [np.flatnonzero(lit.any(axis=axis)) for axis in (0, 1)]
        extents = [
            (found[-1] - found[0] + 1) / n for found, n in zip(sides, lit.shape[::-1], strict=True) if found.size
        ]
        return cls(float(lit.mean()), float(max(extents, default=0.0)))


def shown_in_viewers(project: Path, files: list[Path], pictures: Path | None) -> list[Shown]:
    """Show each of `files`, exported from `project`, in each viewer that reads it; keep screenshots in `pictures`."""
    cameras = read_camera_set(project / "cameras").cameras
    chosen = [cameras[index] for index in np.linspace(0, len(cameras) - 1, N_VIEWS).astype(int)]
    looks = [(np.asarray(one.center), np.asarray(one.center + one.viewmat[2, :3])) for one in chosen]
    with chromium() as browser, served(files) as (address, folder):
        found = []
        for file in files:
            gaussians = (read_glb if file.suffix == ".glb" else read_ply)(file)
            expected = [_engine_picture(Scene(gaussians), *look) for look in looks]
            for viewer in VIEWERS:
                if file.suffix not in viewer.suffixes:
                    continue
                shots = []
                for look in (*looks, None):
                    placed = None if look is None else tuple(viewer.place(point, file.suffix) for point in look)
                    page = viewer.address(file.name, placed, folder)  # type: ignore[arg-type]
                    shots.append(_screenshot(browser, f"{address}/{page}", folder))
                if pictures is not None:
                    pictures.mkdir(parents=True, exist_ok=True)
                    keep_pictures(
                        pictures / f"{viewer.name.lower()}_{file.suffix[1:]}.jpg", [expected[0], shots[0], shots[-1]]
                    )
                pairs = list(zip(shots, expected, strict=False))
                found.append(
                    Shown(
                        viewer.name,
                        file.suffix[1:].upper(),
                        tuple(psnr(shot, wanted) for shot, wanted in pairs),
                        float(np.mean([psnr(shot, wanted[::-1, ::-1]) for shot, wanted in pairs])),
                        Framed.of(shots[-1]),
                    )
                )
    return found


def framed_by_viewers(files: list[Path], pictures: Path | None) -> list[tuple[str, str, Framed]]:
    """Return the viewer, the kind of file and how it is framed for each of `files` that a viewer reads.

    `pictures` is the folder of screenshots, one for each kind of file, with the viewers side by side.
    """
    found = []
    with chromium() as browser, served(files) as (address, folder):
        for file in files:
            shots = []
            for viewer in VIEWERS:
                if file.suffix in viewer.suffixes:
                    page = viewer.address(file.name, None, folder)
                    shots.append(_screenshot(browser, f"{address}/{page}", folder))
                    found.append((viewer.name, file.suffix[1:].upper(), Framed.of(shots[-1])))
            if pictures is not None:
                pictures.mkdir(parents=True, exist_ok=True)
                keep_pictures(pictures / f"object_{file.suffix[1:]}.jpg", shots)
    return found


def camera_at(eye: Point, target: Point, fov: float = FOV) -> PinholeCamera:
    """Return a level camera of the viewers' size; `fov` is its vertical field of view in degrees."""
    focal = HEIGHT / (2 * np.tan(np.radians(fov) / 2))
    K = np.array([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1.0]])
    return PinholeCamera(looking_along(eye, target - eye), K, WIDTH, HEIGHT)


def _engine_picture(scene: Scene, eye: Point, target: Point) -> NDArray[np.float64]:
    """Return the engine's picture, [H, W, 3] in [0, 1]."""
    return scene.render(camera_at(eye, target), color=True).channels.clip(0, 1).astype(np.float64)


def keep_pictures(file: Path, pictures: list[NDArray[np.float64]]) -> None:
    """Write pictures of viewers side by side, at half their size."""
    row = np.concatenate(pictures, axis=1)
    size = (len(pictures) * WIDTH // 2, HEIGHT // 2)
    Image.fromarray(np.round(row * 255).astype(np.uint8)).resize(size).save(file, quality=85)


def _screenshot(browser: Browser, address: str, folder: Path) -> NDArray[np.float64]:
    """Return the picture of a page once it has stopped changing."""
    file = folder / "shot.png"
    with browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}) as context:
        page = context.new_page()
        page.goto(address)
        last = np.zeros((HEIGHT, WIDTH, 3))
        for _ in range(MAX_SECONDS // 3):
            page.wait_for_timeout(3000)
            page.screenshot(path=file, timeout=MAX_SECONDS * 1000)
            now = read_picture(file)
            if (now > 0.05).any() and np.abs(now - last).mean() < 1e-4:
                return now
            last = now
    raise EnvironmentProblem(f"{address} showed nothing steady in {MAX_SECONDS} seconds.")


def own_picture(browser: Browser, address: str) -> NDArray[np.float64]:
    """Return the picture that a page gives of itself as `picture`, [HEIGHT, WIDTH, 3], before black."""
    with browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}) as context:
        page = context.new_page()
        page.goto(address)
        try:
            page.wait_for_function("window.picture || window.failed", timeout=1000 * MAX_SECONDS)
        except PageTimeout as error:
            raise EnvironmentProblem(f"{address} drew nothing in {MAX_SECONDS} seconds.") from error
        failed, picture = page.evaluate("[window.failed, window.picture]")
    if failed:
        raise EnvironmentProblem(f"{address} drew nothing: {failed}")
    with Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))) as image:
        shown = np.asarray(image.convert("RGBA"), np.float64) / 255
    return shown[..., :3] * shown[..., 3:]


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def served(files: list[Path]) -> Iterator[tuple[str, Path]]:
    """Serve the viewers and `files` to this computer alone; yield the address and the folder."""
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "node_modules").symlink_to(HERE / "node_modules")
        for page in HERE.glob("*.html"):
            shutil.copyfile(page, folder / page.name)
        shutil.copytree(HERE / "node_modules" / "@playcanvas" / "supersplat-viewer" / "public", folder / "supersplat")
        for file in files:
            shutil.copyfile(file, folder / file.name)
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=name))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", folder
        finally:
            server.shutdown()


def listed(point: Point) -> str:
    """Return a point as pages are asked for it."""
    return ",".join(f"{value:.9g}" for value in point)


def _babylon_place(point: Point, suffix: str) -> Point:
    x, y, z = point
    # Its world is left-handed with Y up; glTF is turned about Y besides.
    return np.array([x, z, y] if suffix == ".ply" else [-x, z, -y])


def _babylon_address(name: str, look: tuple[Point, Point] | None, folder: Path) -> str:
    asked = {"file": name}
    if look is not None:
        asked |= {"eye": listed(look[0]), "target": listed(look[1]), "fov": str(FOV)}
    return f"babylon.html?{urllib.parse.urlencode(asked)}"


def _supersplat_place(point: Point, suffix: str) -> Point:
    x, y, z = point
    # The file is turned by 180 degrees about Z.
    return np.array([-x, z, y])


def _supersplat_address(name: str, look: tuple[Point, Point] | None, folder: Path) -> str:
    off = {"enabled": False}
    settings = {
        "version": 2,
        "tonemapping": "none",
        "highPrecisionRendering": False,
        "background": {"color": [0, 0, 0]},
        "postEffectSettings": {
            "sharpness": {**off, "amount": 0},
            "bloom": {**off, "intensity": 0, "blurLevel": 2},
            "grading": {**off, "brightness": 1, "contrast": 1, "saturation": 1, "tint": [1, 1, 1]},
            "vignette": {**off, "intensity": 0, "inner": 0, "outer": 1, "curvature": 1},
            "fringing": {**off, "intensity": 0},
        },
        "animTracks": [],
        "cameras": [],
        "annotations": [],
        "startMode": "default",
    }
    if look is not None:
        eye, target = ([float(value) for value in point] for point in look)
        # The angle is that of the longer side.
        across = float(np.degrees(2 * np.arctan(np.tan(np.radians(FOV) / 2) * WIDTH / HEIGHT)))
        settings["cameras"] = [{"initial": {"position": eye, "target": target, "fov": across}}]
    file = folder / "supersplat" / "settings.json"
    file.write_text(json.dumps(settings))
    return f"supersplat/index.html?content=/{name}&settings=settings.json&noui&webgl&noanim"


VIEWERS = (
    Viewer("SuperSplat", (".ply",), _supersplat_place, _supersplat_address),
    Viewer("Babylon", (".ply", ".glb"), _babylon_place, _babylon_address),
)
