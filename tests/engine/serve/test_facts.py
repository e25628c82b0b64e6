"""What the page is told beyond photos and cameras: objects in the scene, videos, times, and files that it may keep."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.pictures import encode_png
from engine.project.objects import ObjectRecord, read_record, save_object
from engine.scene import Detailed
from engine.training.settings import LIGHT_DESCRIPTION, LIGHT_LABEL, OFFERED_PRESETS
from tests.engine.pictures.blob_scene import BLUE, BlobScene

from .conftest import API, Client, jpeg


@pytest.fixture
def project(client: Client, project: str, scene: BlobScene) -> str:
    """A scene with the object ``ball``, which a photo shows in a square of 20 pixels."""
    folder = client.folder(project)
    members = np.asarray(scene.part) == BLUE
    photo = scene.cameras.cameras[0].photo
    record = ObjectRecord(
        "ball", "ball", {"kind": "text", "text": "ball"}, 0.5, 0.9, 0.95, int(members.sum()), len(members),
        evidence=({"photo": photo, "score": 0.9},),
    )  # fmt: skip
    with Image.open(folder / "photos" / photo) as opened:
        mask = np.zeros(opened.size[::-1], bool)
    mask[10:30, 20:40] = True
    save_object(folder / "project", record, members.astype(np.float32), pictures={"evidence.png": encode_png(mask)})
    return project


def test_the_page_offers_the_options_of_the_engines_list(client: Client) -> None:
    told = client.http.get(f"{API}/session").json()
    assert [one["name"] for one in told["presets"]] == [one.name for one in OFFERED_PRESETS]
    assert told["light"] == {"label": LIGHT_LABEL, "description": LIGHT_DESCRIPTION}


def test_the_texts_of_each_language_are_served_to_everybody(client: Client) -> None:
    told = client.http.get(f"{API}/session").json()
    assert told["languages"] == {"en": "English", "de": "Deutsch"}
    answer = client.http.get("/languages/de.json", headers={"Accept-Encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip" and answer.headers["cache-control"] == "no-cache"
    texts = answer.json()["texts"]
    # What the page shows in the words of the engine.
    shown = [*told["stages"].values(), *(one["description"] for one in told["presets"]), LIGHT_DESCRIPTION]
    assert [text for text in shown if text not in texts] == []
    assert client.http.get("/languages/reading.py").status_code == 404


def test_members_of_an_object_are_a_bit_for_each_gaussian(client: Client, project: str, scene: BlobScene) -> None:
    answer = client.http.get(f"{API}/projects/{project}/objects/ball/members")
    count = int(answer.headers["x-count"])
    bits = np.unpackbits(np.frombuffer(answer.content, np.uint8), count=count, bitorder="little")
    assert (bits == (np.asarray(scene.part) == BLUE)).all()


def test_thumbnail_is_cut_out_of_the_photo(client: Client, project: str) -> None:
    address = client.http.get(f"{API}/projects/{project}").json()["objects"][0]["picture"]
    answer = client.http.get(address)
    assert answer.headers["content-type"] == "image/jpeg"
    with Image.open(io.BytesIO(answer.content)) as picture:
        # The square of 20 pixels, and a fifth of it on each side.
        assert picture.size == (28, 28)


def test_object_that_was_found_in_no_photo_is_cut_out_of_one_that_shows_it(
    client: Client, project: str, scene: BlobScene
) -> None:
    """As the background, and what was made by hand."""
    folder = client.folder(project) / "project"
    members = (np.asarray(scene.part) == BLUE).astype(np.float32)
    record = ObjectRecord("hand", "hand", {"kind": "hand"}, 1.0, 0.5, 0.0, int(members.sum()), len(members))
    save_object(folder, record, members)
    answer = client.http.get(f"{API}/projects/{project}/objects/hand/thumbnail.jpg")
    assert answer.status_code == 200
    with Image.open(io.BytesIO(answer.content)) as picture:
        pixels = np.asarray(picture.convert("RGB"), float)
    # The part is blue, so the middle of its picture is.
    red, _, blue = pixels[len(pixels) // 3 : 2 * len(pixels) // 3].mean(axis=(0, 1))
    assert blue > 1.5 * red


def test_object_that_gets_detail_says_so_and_is_in_another_state(
    client: Client, project: str, scene: BlobScene
) -> None:
    """It keeps its number of Gaussians of the scene, by which the page cannot tell that its files are others."""
    folder = client.folder(project) / "project"
    (before,) = client.http.get(f"{API}/projects/{project}").json()["objects"]
    assert not before["has_detail"]
    members = np.asarray(scene.part) == BLUE
    rows = np.flatnonzero(members)
    means = np.asarray(scene.gaussians.means)[rows]
    detailed = Detailed(rows, means, rows, replace(scene.gaussians[rows], means=means + np.float32(0.01)))
    record = replace(read_record(folder / "objects" / "ball" / "object.json"), detail={"kept": True})
    save_object(folder, record, members.astype(np.float32), detailed=detailed)
    (after,) = client.http.get(f"{API}/projects/{project}").json()["objects"]
    assert after["has_detail"] and after["state"] != before["state"]
    assert after["n_gaussians"] == before["n_gaussians"]
    # Its name is no part of its state.
    client.http.patch(f"{API}/projects/{project}/objects/ball", json={"name": "globe"})
    assert client.http.get(f"{API}/projects/{project}").json()["objects"][0]["state"] == after["state"]


def test_object_that_no_photo_shows_has_no_picture(client: Client, project: str) -> None:
    folder = client.folder(project)
    (folder / "project" / "objects" / "ball" / "evidence.png").unlink()
    for photo in (folder / "photos").iterdir():
        photo.unlink()
    assert client.http.get(f"{API}/projects/{project}/objects/ball/thumbnail.jpg").status_code == 404


@pytest.mark.parametrize("file_format", ["spz", "usd"])
def test_scene_is_had_as_spz_and_usd(client: Client, project: str, file_format: str) -> None:
    answer = client.http.get(f"{API}/projects/{project}/export", params={"format": file_format})
    assert answer.status_code == 200 and f'filename="Room.{file_format}"' in answer.headers["content-disposition"]


@pytest.mark.parametrize("place", ["scene.ply", "objects/ball.ply", "objects/ball/thumbnail.jpg"])
def test_file_that_the_browser_has_is_not_sent_again(client: Client, project: str, place: str) -> None:
    first = client.http.get(f"{API}/projects/{project}/{place}")
    again = client.http.get(f"{API}/projects/{project}/{place}", headers={"If-None-Match": first.headers["etag"]})
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")


def test_report_is_made_anew_when_objects_change(client: Client, project: str) -> None:
    folder = client.folder(project) / "project" / "report"
    folder.mkdir(exist_ok=True)
    (folder / "report.html").write_text("the report of the reconstruction")
    text = client.http.get(f"{API}/projects/{project}/report").text
    assert "<h1>Room</h1>" in text and "<h3>ball</h3>" in text
    client.http.patch(f"{API}/projects/{project}/objects/ball", json={"name": "globe"})
    assert "<h3>globe</h3>" in client.http.get(f"{API}/projects/{project}/report").text
    german = client.http.get(f"{API}/projects/{project}/report?language=de").text
    assert "<h3>globe</h3>" in german and "Suchwort „ball“" in german
    assert client.http.get(f"{API}/projects/{project}/report?language=../x").status_code == 422


def test_project_in_the_list_has_a_photo(client: Client) -> None:
    project = client.new_project()
    assert client.http.get(f"{API}/projects").json()[0]["cover"] == ""
    assert client.upload(project, "one.jpg", jpeg()).status_code == 204
    assert client.http.get(f"{API}/projects").json()[0]["cover"] == "one.jpg"


def test_video_that_cannot_be_read_is_listed_with_the_reason_and_removed(
    client: Client, fake_engine: Callable[[str], None]
) -> None:
    fake_engine("say('error', message='walk.mp4 is not a video.', error='PhotoError'); sys.exit(1)")
    project = client.new_project()
    client.upload(project, "walk.mp4", b"\0\0\0\x18ftypmp42" + bytes(100))
    client.wait_for_job(project, "stopped")
    (video,) = client.http.get(f"{API}/projects/{project}").json()["videos"]
    assert (video["name"], video["n_photos"], video["problem"]) == ("walk.mp4", 0, "walk.mp4 is not a video.")
    assert client.http.delete(f"{API}/projects/{project}/photos/walk.mp4").status_code == 200
    assert client.http.get(f"{API}/projects/{project}").json()["videos"] == []
    assert client.http.delete(f"{API}/projects/{project}/photos/walk.mp4").status_code == 404


def test_more_photos_are_taken_from_a_video(client: Client) -> None:
    project = client.new_project()
    client.upload(project, "walk.mp4", b"\0\0\0\x18ftypmp42" + bytes(100))
    client.wait_for_job(project, "finished")
    order = {"kind": "frames", "video": "walk.mp4", "density": 2}
    assert client.http.post(f"{API}/projects/{project}/jobs", json=order).status_code == 202
    client.wait_for_job(project, "finished")
    words = (client.folder(project) / "photos" / "words.json").read_text()
    assert "--density=2" in words
    (video,) = client.http.get(f"{API}/projects/{project}").json()["videos"]
    assert video["density"] == 2
    assert client.http.post(f"{API}/projects/{project}/jobs", json={**order, "video": "../x.mp4"}).status_code == 404


def test_page_is_compressed_and_kept(client: Client, page: Path) -> None:
    text = "let a = 1;\n" * 1000
    (page / "app.js").write_text(text)
    first = client.http.get("/app.js", headers={"Accept-Encoding": "gzip"})
    assert first.headers["content-encoding"] == "gzip" and int(first.headers["content-length"]) < len(text) / 10
    assert first.text == text
    again = client.http.get("/app.js", headers={"If-None-Match": first.headers["etag"], "Accept-Encoding": "gzip"})
    assert (again.status_code, again.content) == (304, b"")
    (page / "app.js").write_text(text + "a;")
    os.utime(page / "app.js", ns=(1, 1))
    assert client.http.get("/app.js").text == text + "a;"
    plain = client.http.get("/app.js", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers and plain.text == text + "a;"


def test_time_of_each_preset_is_told_and_kept(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    from engine.serve import forecasts

    calls: list[list[str]] = []

    def plan(arguments: list[str], what: str) -> dict[str, object]:
        calls.append(arguments)
        return {"presets": [{"name": "preview", "forecast": {"seconds": [60.0, 120.0, 300.0]}}]}

    monkeypatch.setattr(forecasts, "call_engine", plan)
    project = client.new_project()
    assert client.http.get(f"{API}/projects/{project}/forecast").status_code == 409
    client.upload(project, "one.jpg", jpeg(1))
    for _ in range(2):
        assert client.http.get(f"{API}/projects/{project}/forecast").json() == {"preview": [60.0, 120.0, 300.0]}
    client.upload(project, "two.jpg", jpeg(2))
    client.http.get(f"{API}/projects/{project}/forecast")
    assert len(calls) == 2 and "--every-preset" in calls[0]
