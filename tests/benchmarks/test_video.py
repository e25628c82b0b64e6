"""The film of a project: a calm way through the photos' places, as many pictures as were rendered."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

from benchmarks.video import FRAMES_PER_SECOND, HEIGHT, WIDTH, four, way_through, write_film
from engine.scene import Camera


def camera(number: int, x: float) -> Camera:
    viewmat = np.eye(4)
    viewmat[0, 3] = -x
    return Camera(f"view_{number:02}.jpg", 800, 600, "PINHOLE", (700.0, 700.0, 400.0, 300.0), viewmat)


def test_camera_goes_from_photo_to_photo_with_even_steps() -> None:
    way = way_through([camera(2, 5.0), camera(0, 0.0), camera(1, 1.0)], 11)
    places = np.array([one.center[0] for one in way])
    np.testing.assert_allclose(places, np.linspace(0, 5, 11), atol=1e-9)
    assert all((one.width, one.height) == (WIDTH, HEIGHT) for one in way)
    # The focal length is that of the photos, at the size of the film.
    np.testing.assert_allclose(way[0].K[0, 0], 700 * WIDTH / 800, rtol=0.01)


def test_film_has_every_picture(tmp_path: Path) -> None:
    frames = [np.full((HEIGHT, WIDTH, 3), 40 * number, np.uint8) for number in range(6)]
    write_film(tmp_path / "film.webm", frames)
    with av.open(str(tmp_path / "film.webm")) as film:
        assert film.streams.video[0].average_rate == FRAMES_PER_SECOND
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(shown) == len(frames)
    # Plain pictures are kept but for the range of video colours, and rounding.
    assert max(abs(float(a.mean()) - float(b.mean())) for a, b in zip(shown, frames, strict=True)) < 4


def test_four_pictures_of_any_shape_fill_a_panel() -> None:
    panel = four([np.zeros(shape, np.uint8) for shape in ((600, 800, 3), (800, 600, 3), (100, 100, 3), (90, 160, 3))])
    assert panel.shape == (360, 480, 3)
    assert (panel[:180, :240] == 0).all() and (panel[180, 0] > 200).all()
