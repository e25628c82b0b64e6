"""What the viewer gets: cameras, and where the photos show a place of the scene."""

from __future__ import annotations

import numpy as np
import pytest

from tests.engine.pictures.blob_scene import BlobScene

from .conftest import API, Client

PART = 1


def test_cameras_look_at_the_middle_of_the_scene(client: Client, project: str, scene: BlobScene) -> None:
    found = client.http.get(f"{API}/projects/{project}/cameras").json()
    assert [view["photo"] for view in found["views"]] == [camera.photo for camera in scene.cameras.cameras]
    distances = [np.linalg.norm(camera.center - found["center"]) for camera in scene.cameras.cameras]
    assert found["radius"] == pytest.approx(np.median(distances))
    # All cameras of this scene stand around its origin and look at it.
    assert np.linalg.norm(found["center"]) < 0.2 * found["radius"]


def test_place_of_the_scene_is_shown_where_the_photo_shows_it(client: Client, project: str, scene: BlobScene) -> None:
    camera = scene.cameras.cameras[2]
    part = np.asarray(scene.gaussians.means)[np.asarray(scene.part) == PART].mean(0)
    x, y, z = (float(value) for value in part)
    pixel = client.http.get(
        f"{API}/projects/{project}/views/{camera.photo}/pixel", params={"x": x, "y": y, "z": z}
    ).json()
    # A blob and the middle of its mask agree within a tenth of the picture.
    assert np.hypot(*np.subtract((pixel["x"], pixel["y"]), scene.center_of(PART, camera.photo))) < 0.1 * camera.width


def test_place_behind_a_camera_is_in_no_pixel(client: Client, project: str, scene: BlobScene) -> None:
    camera = scene.cameras.cameras[0]
    x, y, z = camera.center - np.asarray(camera.viewmat)[2, :3]
    answer = client.http.get(f"{API}/projects/{project}/views/{camera.photo}/pixel", params={"x": x, "y": y, "z": z})
    assert answer.status_code == 200 and answer.json() is None


def test_photo_without_a_camera_is_not_found(client: Client, project: str) -> None:
    answer = client.http.get(f"{API}/projects/{project}/views/other.jpg/pixel", params={"x": 0, "y": 0, "z": 0})
    assert answer.status_code == 404


def test_scene_is_downloaded_under_the_name_of_the_project(client: Client, project: str) -> None:
    answer = client.http.get(f"{API}/projects/{project}/export", params={"format": "ply"})
    assert answer.status_code == 200 and 'filename="Room.ply"' in answer.headers["content-disposition"]
    assert answer.content.startswith(b"ply\n")
    answer = client.http.get(f"{API}/projects/{project}/export", params={"format": "sog"})
    assert answer.headers["content-type"] == "application/zip" and answer.content.startswith(b"PK")


def test_scene_for_the_viewer_is_the_gaussians_alone(client: Client, project: str) -> None:
    """What the viewer does not show, the record and how many photos saw each Gaussian, would only be waited for."""
    shown = client.http.get(f"{API}/projects/{project}/scene.ply").content.partition(b"end_header")[0]
    kept = client.http.get(f"{API}/projects/{project}/export", params={"format": "ply"}).content
    record = kept.partition(b"end_header")[0]
    assert b"photos_seen" in record and b"title" in record
    assert b"photos_seen" not in shown and b"title" not in shown
