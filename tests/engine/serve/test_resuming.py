"""Uploads continue where they stopped, leave nothing behind, and keep nobody waiting; by the text of tus 1.0.0."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from engine.serve import small_photos
from engine.serve.settings import ServeSettings
from engine.serve.transfers import Transfers
from engine.serve.unfinished import Upload
from tests.conftest import wait_until

from .conftest import API, Client, jpeg
from .test_uploads import names

TUS = {"Tus-Resumable": "1.0.0"}


def folder(client: Client) -> Path:
    return client.data / "users" / "local" / "uploads"


def test_photos_of_one_name_that_arrive_together_are_all_kept(client: Client) -> None:
    project, photos = client.new_project(), [jpeg(seed, 24) for seed in range(40)]
    with ThreadPoolExecutor(40) as pool:
        answers = list(pool.map(lambda photo: client.upload(project, "image.jpg", photo).status_code, photos))
    assert answers == [204] * 40
    stored = [file.read_bytes() for file in (client.folder(project) / "photos").iterdir()]
    assert sorted(stored) == sorted(photos) and len(names(client, project)) == 40
    # The hashes of all are known: none is taken twice.
    assert [client.upload(project, "again.jpg", photo).status_code for photo in photos[::13]] == [409] * 4


def test_two_equal_photos_that_arrive_together_are_one(client: Client) -> None:
    project = client.new_project()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: client.upload(project, "image.jpg", jpeg()).status_code, range(8)))
    assert sorted(answers) == [204] + [409] * 7 and names(client, project) == ["image.jpg"]


def test_upload_of_the_page_is_found_again_without_a_file_type(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    metadata = f"project {encoded(project)},filename {encoded('vase.jpg')}"
    headers = {**TUS, "Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    location = client.http.post(f"{API}/uploads/", headers=headers).headers["location"]
    client.send(location, content[:700])
    head = client.http.head(location, headers=TUS)
    assert (head.status_code, head.headers["upload-offset"], head.headers["upload-length"]) == (
        200, "700", str(len(content)),
    )  # fmt: skip
    assert head.headers["cache-control"] == "no-store" and head.headers["tus-resumable"] == "1.0.0"


def encoded(text: str) -> str:
    import base64

    return base64.b64encode(text.encode()).decode()


def test_upload_continues_after_a_restart_of_the_server(make_client: Callable[..., Client]) -> None:
    first, content = make_client(), jpeg()
    project = first.new_project()
    location = first.begin(project, "vase.jpg", len(content)).headers["location"]
    first.send(location, content[:1000])
    first.stop()
    second = make_client()
    assert second.http.head(location, headers=TUS).headers["upload-offset"] == "1000"
    assert second.send(location, content[1000:], 1000).status_code == 204
    assert (second.folder(project) / "photos" / "vase.jpg").read_bytes() == content


def test_server_that_ended_before_the_check_takes_the_photo_when_it_is_asked(
    make_client: Callable[..., Client],
) -> None:
    first, content = make_client(), jpeg()
    project = first.new_project()
    location = first.begin(project, "vase.jpg", len(content)).headers["location"]
    first.stop()
    (folder(first) / location.rpartition("/")[2]).write_bytes(content)
    second = make_client()
    assert second.http.head(location, headers=TUS).headers["upload-offset"] == str(len(content))
    assert names(second, project) == ["vase.jpg"] and list(folder(second).iterdir()) == []


def test_client_that_missed_the_last_answer_learns_that_all_arrived(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    location = client.begin(project, "vase.jpg", len(content)).headers["location"]
    client.send(location, content)
    assert client.http.head(location, headers=TUS).headers["upload-offset"] == str(len(content))
    assert client.send(location, b"", len(content)).status_code == 204
    assert names(client, project) == ["vase.jpg"]


def test_wrong_offset_is_told_apart_from_a_refused_file(client: Client) -> None:
    location = client.begin(client.new_project(), "vase.jpg", 2000).headers["location"]
    answer = client.send(location, b"x" * 10, 5)
    assert answer.status_code == 409 and answer.headers["upload-offset"] == "0"


def test_refused_part_leaves_no_byte(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    location = client.begin(project, "vase.jpg", len(content)).headers["location"]
    client.send(location, content[:1000])

    def parts() -> object:
        # Without a stated length: only the bytes themselves tell that they are too many.
        yield content[1000:]
        yield b"x" * 500_000

    headers = {**TUS, "Upload-Offset": "1000", "Content-Type": "application/offset+octet-stream"}
    for _ in range(3):
        assert client.http.patch(location, content=parts(), headers=headers).status_code == 413
        assert client.send(location, content[1000:] + b"x", 1000).status_code == 413
    assert sum(file.stat().st_size for file in folder(client).iterdir() if not file.suffix) == 1000
    assert client.send(location, content[1000:], 1000).status_code == 204
    assert (client.folder(project) / "photos" / "vase.jpg").read_bytes() == content


def test_body_of_the_first_request_is_not_read(client: Client) -> None:
    headers = {**TUS, "Upload-Length": "9", "Content-Length": str(3 << 30)}
    assert client.http.post(f"{API}/uploads/", headers=headers).status_code == 413


def test_what_was_announced_counts_from_the_first_moment(make_client: Callable[..., Client]) -> None:
    client = make_client(max_user_bytes=20_000)
    project = client.new_project()
    with ThreadPoolExecutor(8) as pool:
        begun = list(pool.map(lambda _: client.begin(project, "vase.jpg", 6000), range(8)))
    assert sorted(answer.status_code for answer in begun) == [201] * 3 + [507] * 5
    location = next(answer.headers["location"] for answer in begun if answer.status_code == 201)
    assert client.http.delete(location, headers=TUS).status_code == 204
    assert client.begin(project, "vase.jpg", 6000).status_code == 201


def test_full_disk_while_bytes_arrive_is_told_and_the_upload_goes_on_later(client: Client) -> None:
    resource = pytest.importorskip("resource")
    project, content = client.new_project(), jpeg()
    location = client.begin(project, "vase.jpg", len(content)).headers["location"]
    assert client.send(location, content[:600]).status_code == 204
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Stands for a full disk: the system writes a part, and refuses the rest.
    resource.setrlimit(resource.RLIMIT_FSIZE, (1500, before[1]))
    try:
        answer = client.send(location, content[600:], 600)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert answer.status_code == 507 and "The disk of the server is full" in answer.json()["detail"]
    assert client.http.head(location, headers=TUS).headers["upload-offset"] == "600"
    assert client.send(location, content[600:], 600).status_code == 204
    assert (client.folder(project) / "photos" / "vase.jpg").read_bytes() == content


def test_bytes_that_changed_on_their_way_are_noticed(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    metadata = ",".join(
        f"{name} {encoded(value)}"
        for name, value in (("project", project), ("filename", "vase.jpg"), ("sha256", "0" * 64))
    )
    headers = {**TUS, "Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    location = client.http.post(f"{API}/uploads/", headers=headers).headers["location"]
    answer = client.send(location, content)
    assert answer.status_code == 415 and "was damaged on its way" in answer.json()["detail"]
    assert names(client, project) == [] and list(folder(client).iterdir()) == []


def test_abandoned_pieces_are_deleted_while_the_server_runs(make_client: Callable[..., Client]) -> None:
    client = make_client(tidy_seconds=0.02)
    project = client.new_project()
    old = client.begin(project, "old.jpg", 2000).headers["location"].rpartition("/")[2]
    new = client.begin(project, "new.jpg", 2000).headers["location"].rpartition("/")[2]
    client.send(f"{API}/uploads/{old}", b"x" * 10)
    long_ago = folder(client).joinpath(old).stat().st_mtime - 10 * 86400
    client.http.app.state.server.uploads.find("local", old).began = long_ago  # type: ignore[attr-defined]
    os.utime(folder(client) / old, (long_ago, long_ago))
    wait_until(lambda: not (folder(client) / old).exists())
    assert (folder(client) / new).exists()
    assert client.http.head(f"{API}/uploads/{old}", headers=TUS).status_code == 404


def test_continued_upload_ends_the_stale_one(tmp_path: Path) -> None:
    async def take_over() -> list[str]:
        transfers, seen = Transfers(), []
        upload = Upload("0" * 32, "ada", "p", "a.jpg", 10, "", tmp_path / "a")
        began = asyncio.Event()

        async def stale() -> None:
            async with transfers.held(upload) as wanted:
                began.set()
                await wanted
                seen.append("stale ended")

        first = asyncio.create_task(stale())
        await began.wait()
        async with transfers.held(upload):
            seen.append("continued")
        await first
        return seen

    assert asyncio.run(take_over()) == ["stale ended", "continued"]


def test_uploads_that_are_checked_take_no_thread_from_other_requests(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, go_on, begun = client.new_project(), threading.Event(), threading.Event()
    real = small_photos.write_small_photo

    def slow(*arguments: object, **options: object) -> None:
        begun.set()
        go_on.wait(60)
        real(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("engine.serve.intake.write_small_photo", slow)
    with ThreadPoolExecutor(60) as pool:
        sent = [pool.submit(client.upload, project, "a.jpg", jpeg(seed, 24)) for seed in range(60)]
        begun.wait(60)
        # More uploads than the server has threads for requests.
        assert client.http.get(f"{API}/projects").status_code == 200
        go_on.set()
        assert [one.result().status_code for one in sent] == [204] * 60


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Tus-Resumable": "0.2.2"}, 412),
        ({"Upload-Length": "-1"}, 400),
        ({"Upload-Length": "x"}, 400),
        ({"Upload-Metadata": "project !!!"}, 400),
        ({"Upload-Metadata": "project //8="}, 400),
    ],
)
def test_request_that_is_no_tus_is_refused(client: Client, headers: dict[str, str], status: int) -> None:
    answer = client.http.post(f"{API}/uploads/", headers={**TUS, "Upload-Length": "5", **headers})
    assert answer.status_code == status and answer.headers["tus-resumable"] == "1.0.0"
    assert status != 412 or answer.headers["tus-version"] == "1.0.0"


def test_server_says_what_it_can(client: Client) -> None:
    answer = client.http.options(f"{API}/uploads/")
    assert answer.status_code == 204 and answer.headers["tus-version"] == "1.0.0"
    assert answer.headers["tus-extension"] == "creation,termination"
    assert answer.headers["tus-max-size"] == str(ServeSettings(client.data).max_video_bytes)
