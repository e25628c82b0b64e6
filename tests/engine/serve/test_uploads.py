"""Uploads are resumed, checked by their content, and never leave the folder of their user."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from PIL import Image

from engine.core.errors import FormatError
from engine.serve.intake import photo_name

from .conftest import API, Client, jpeg


def names(client: Client, project: str) -> list[str]:
    return [photo["name"] for photo in client.http.get(f"{API}/projects/{project}").json()["photos"]]


def test_photo_arrives_in_its_project_bit_by_bit(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    assert client.upload(project, "vase.jpg", content).status_code == 204
    assert names(client, project) == ["vase.jpg"]
    assert (client.folder(project) / "photos" / "vase.jpg").read_bytes() == content
    small = client.http.get(f"{API}/projects/{project}/photos/vase.jpg")
    assert small.status_code == 200 and small.headers["content-type"] == "image/jpeg"


def test_interrupted_upload_continues_where_it_was(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    location = client.begin(project, "vase.jpg", len(content)).headers["location"]
    assert client.send(location, content[:1000]).status_code == 204
    head = client.http.head(location, headers={"Tus-Resumable": "1.0.0"})
    assert head.headers["upload-offset"] == "1000"
    assert client.send(location, content[500:], 500).status_code == 409
    assert client.send(location, content[1000:], 1000).status_code == 204
    assert (client.folder(project) / "photos" / "vase.jpg").read_bytes() == content
    assert not list((client.data / "users" / "local" / "uploads").glob("*.info"))


@pytest.mark.parametrize(
    ("name", "content", "status", "sentence"),
    [
        ("vase.jpg", b"no picture at all", 415, "vase.jpg is not a picture"),
        ("vase.jpg", jpeg()[:900], 415, "vase.jpg"),
        ("vase.svg", b"<svg/>", 415, "is not a photo or video"),
        ("vase.html", b"<script>", 415, "is not a photo or video"),
    ],
)
def test_what_is_no_photo_is_refused_and_deleted(
    client: Client, name: str, content: bytes, status: int, sentence: str
) -> None:
    project = client.new_project()
    answer = client.upload(project, name, content)
    assert answer.status_code == status and sentence in answer.json()["detail"]
    assert names(client, project) == []
    left = [path for path in (client.data / "users").rglob("*") if path.is_file() and path.name != "info.json"]
    assert left == []


def heic(seed: int = 0) -> bytes:
    stream = io.BytesIO()
    pixels = np.random.default_rng(seed).integers(0, 255, (64, 96, 3), np.uint8)
    pillow_heif.from_pillow(Image.fromarray(pixels)).save(stream, quality=80)
    return stream.getvalue()


def test_content_of_an_upload_says_what_it_is(client: Client) -> None:
    project = client.new_project()
    for name, content in (("a.heic", heic(0)), ("b.jpg", heic(1)), ("c.HEIC", jpeg(2)), ("d.mov", jpeg(3))):
        assert client.upload(project, name, content).status_code == 204
        assert client.http.get(f"{API}/projects/{project}/photos/{name.replace('.mov', '.jpg')}").status_code == 200
    assert names(client, project) == ["a.heic", "b.jpg", "c.HEIC", "d.jpg"]


def test_moving_part_of_a_live_photo_is_not_taken_for_a_video(client: Client) -> None:
    project = client.new_project()
    assert client.upload(project, "IMG_1.HEIC", heic()).status_code == 204
    answer = client.upload(project, "IMG_1.MOV", b"\0\0\0\x14ftypqt  \0\0\0\0qt  " + bytes(100))
    assert answer.status_code == 409
    assert answer.json()["detail"] == "IMG_1.MOV is the moving part of the Live Photo IMG_1.HEIC. The photo suffices."


def test_same_photo_is_taken_once_and_another_of_the_same_name_gets_a_number(client: Client) -> None:
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg(0))
    again = client.upload(project, "copy.jpg", jpeg(0))
    assert again.status_code == 409 and again.json()["detail"] == "copy.jpg was uploaded already, as vase.jpg."
    assert client.upload(project, "vase.jpg", jpeg(1)).status_code == 204
    assert names(client, project) == ["vase 2.jpg", "vase.jpg"]
    client.http.delete(f"{API}/projects/{project}/photos/vase.jpg")
    assert client.upload(project, "vase.jpg", jpeg(0)).status_code == 204


@pytest.mark.parametrize(
    ("filename", "stored"),
    [
        ("../../etc/passwd.jpg", "passwd.jpg"),
        ("C:\\Users\\me\\vase.JPG", "vase.JPG"),
        (".jpg", None),
        ("a\0b.png", "a_b.png"),
        ("Ölkanne für morgen.jpeg", "Ölkanne für morgen.jpeg"),
        ("<b>.webp", "_b_.webp"),
        ("x" * 300 + ".jpg", "x" * 116 + ".jpg"),
        ("photo.jpg/..", None),
        ("花" * 84 + ".jpg", "花" * 38 + ".jpg"),
    ],
)
def test_names_are_never_paths(filename: str, stored: str | None) -> None:
    if stored is None:
        with pytest.raises(FormatError, match="is not a photo or video"):
            photo_name(filename)
    else:
        assert photo_name(filename) == stored


def test_photo_larger_than_allowed_is_refused_before_its_first_byte(make_client: Callable[..., Client]) -> None:
    client = make_client(max_photo_bytes=5000)
    project = client.new_project()
    location = client.begin(project, "vase.jpg", 4000).headers["location"]
    assert client.begin(project, "vase.jpg", 6000).status_code == 413
    # More than was announced.
    assert client.send(location, b"x" * 4500).status_code in (400, 413)


def test_quota_disk_and_number_of_photos_are_told(make_client: Callable[..., Client]) -> None:
    client = make_client(max_user_bytes=20_000, max_photos=1)
    project = client.new_project()
    assert "would take more than your" in client.begin(project, "vase.jpg", 30_000).json()["detail"]
    assert client.begin(project, "vase.jpg", 30_000).status_code == 507
    assert client.upload(project, "a.jpg", jpeg(0)).status_code == 204
    assert "which is the limit" in client.upload(project, "b.jpg", jpeg(1)).json()["detail"]


def test_full_disk_is_told(make_client: Callable[..., Client]) -> None:
    client = make_client(min_free_bytes=1 << 60)
    answer = client.begin(client.new_project(), "vase.jpg", 1000)
    assert answer.status_code == 507 and "The disk of the server is full" in answer.json()["detail"]


def test_a_thousand_half_open_uploads_are_not_possible(make_client: Callable[..., Client]) -> None:
    client = make_client(max_open_uploads=5)
    project = client.new_project()
    statuses = [client.begin(project, f"{number}.jpg", 1000).status_code for number in range(7)]
    assert statuses == [201] * 5 + [429] * 2


@pytest.mark.parametrize("header", ["Upload-Concat", "Upload-Defer-Length", "X-HTTP-Method-Override"])
def test_extensions_that_pass_the_limits_are_refused(client: Client, header: str) -> None:
    assert client.begin(client.new_project(), "vase.jpg", 1000, **{header: "1"}).status_code in (400, 405)


@pytest.mark.parametrize("upload_id", ["..%2fsecret", "x", "0" * 32, "%00" * 16, ".locks"])
def test_unknown_uploads_and_path_tricks_are_not_found(client: Client, upload_id: str) -> None:
    answer = client.send(f"{API}/uploads/{upload_id}", b"x")
    assert answer.status_code in (404, 405)


def test_upload_to_a_project_of_nobody_is_refused(client: Client) -> None:
    assert client.begin("0" * 12, "vase.jpg", 1000).status_code == 404
    assert client.begin("../../..", "vase.jpg", 1000).status_code == 404


def test_old_unfinished_uploads_are_deleted_at_the_start(make_client: Callable[..., Client], tmp_path: Path) -> None:
    import os

    uploads = tmp_path / "data" / "users" / "local" / "uploads"
    uploads.mkdir(parents=True)
    for name, age in (("old", 10 * 86400), ("new", 0)):
        (uploads / name).write_text("x")
        os.utime(uploads / name, (os.path.getmtime(uploads / name) - age,) * 2)
    make_client()
    assert [path.name for path in uploads.iterdir()] == ["new"]


def test_video_becomes_photos_by_a_job(client: Client) -> None:
    project = client.new_project()
    assert client.upload(project, "walk.mp4", b"a video").status_code == 204
    job = client.wait_for_job(project, "finished")
    assert (job["label"], job["subject"]) == ("Take photos from {}", "walk.mp4")
    assert names(client, project) == []
    assert client.upload(project, "walk.mp4", b"a video").status_code == 409
