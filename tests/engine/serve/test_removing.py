"""Nothing that a user made is gone at one press; what is damaged can be seen, removed and replaced."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.serve.trash import Trash
from tests.conftest import wait_until

from .conftest import API, Client, jpeg
from .test_uploads import names

VIDEO = b"\0\0\0\x14ftypqt  \0\0\0\0qt  "


def removed(client: Client, project: str) -> list[str]:
    return [item["name"] for item in client.http.get(f"{API}/projects/{project}").json()["removed"]]


def videos(client: Client, project: str) -> list[str]:
    return [video["name"] for video in client.http.get(f"{API}/projects/{project}").json()["videos"]]


def test_removed_photo_is_brought_back(client: Client) -> None:
    project, content = client.new_project(), jpeg()
    client.upload(project, "vase.jpg", content)
    answer = client.http.delete(f"{API}/projects/{project}/photos/vase.jpg")
    assert answer.status_code == 200 and names(client, project) == [] and removed(client, project) == ["vase.jpg"]
    # Meanwhile another photo has got the name.
    client.upload(project, "vase.jpg", jpeg(1))
    back = client.http.post(f"{API}/projects/{project}/trash/{answer.json()['id']}/restore")
    assert back.json() == {"name": "vase 2.jpg"} and removed(client, project) == []
    assert (client.folder(project) / "photos" / "vase 2.jpg").read_bytes() == content
    assert client.http.post(f"{API}/projects/{project}/trash/{answer.json()['id']}/restore").status_code == 404


def test_small_picture_is_not_that_of_a_removed_photo(client: Client) -> None:
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg(0))
    before = client.http.get(f"{API}/projects/{project}/photos/vase.jpg").content
    client.http.delete(f"{API}/projects/{project}/photos/vase.jpg")
    client.upload(project, "vase.jpg", jpeg(1))
    assert client.http.get(f"{API}/projects/{project}/photos/vase.jpg").content != before


def test_damaged_video_is_seen_removed_and_replaced(client: Client) -> None:
    project = client.new_project()
    assert client.upload(project, "walk.mov", VIDEO + b"damaged").status_code == 204
    client.wait_for_job(project, "finished")
    assert videos(client, project) == ["walk.mov"]
    # Another one of the same name is taken beside it.
    assert client.upload(project, "walk.mov", VIDEO + b"another").status_code == 204
    assert videos(client, project) == ["walk 2.mov", "walk.mov"]
    assert client.http.delete(f"{API}/projects/{project}/photos/walk.mov").status_code == 200
    assert videos(client, project) == ["walk 2.mov"] and removed(client, project) == ["walk.mov"]
    assert client.upload(project, "walk.mov", VIDEO + b"damaged").status_code == 204
    assert videos(client, project) == ["walk 2.mov", "walk.mov"]
    client.wait_for_job(project, "finished")


def test_deleted_project_counts_comes_back_and_is_gone_when_the_trash_is_emptied(
    make_client: Callable[..., Client],
) -> None:
    client = make_client(max_user_bytes=20_000)
    project = client.new_project("Room")
    client.upload(project, "vase.jpg", jpeg())
    size = len(jpeg())
    assert client.http.delete(f"{API}/projects/{project}").status_code == 204
    other = client.new_project("Other")
    (item,) = client.http.get(f"{API}/trash").json()
    assert item["title"] == "Room" and item["bytes"] >= size
    refused = client.begin(other, "a.jpg", 20_000 - size)
    assert refused.status_code == 507 and "empty the trash" in refused.json()["detail"]
    assert client.http.post(f"{API}/trash/{item['id']}/restore").json()["id"] == project
    assert names(client, project) == ["vase.jpg"]
    client.http.delete(f"{API}/projects/{project}")
    assert client.http.delete(f"{API}/trash").status_code == 204
    assert client.http.get(f"{API}/trash").json() == []
    assert client.begin(other, "a.jpg", 20_000 - size).status_code == 201


def test_old_trash_is_emptied_while_the_server_runs(make_client: Callable[..., Client]) -> None:
    client = make_client(tidy_seconds=0.02)
    project = client.new_project()
    for seed, name in enumerate(("old.jpg", "new.jpg")):
        client.upload(project, name, jpeg(seed))
        client.http.delete(f"{API}/projects/{project}/photos/{name}")
    holder = client.folder(project) / "trash" / Trash(client.folder(project) / "trash").items()[1].id
    long_ago = holder.stat().st_mtime - 40 * 86400
    os.utime(holder, (long_ago, long_ago))
    wait_until(lambda: not holder.exists())
    assert removed(client, project) == ["new.jpg"]


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"title": 5}', b"\xff\xfe"])
def test_damaged_description_hides_no_project_and_is_mended_by_a_new_name(client: Client, content: bytes) -> None:
    good, bad = client.new_project("Good"), client.new_project("Bad")
    client.upload(bad, "vase.jpg", jpeg())
    (client.folder(bad) / "info.json").write_bytes(content)
    listed = {one["id"]: one for one in client.http.get(f"{API}/projects").json()}
    assert listed[good]["title"] == "Good" and listed[bad]["title"] == f"Damaged project {bad}"
    assert listed[bad]["state"] == "damaged" and names(client, bad) == ["vase.jpg"]
    assert client.http.patch(f"{API}/projects/{bad}", json={"title": "Mended"}).json()["state"] == "uploaded"
    assert client.http.delete(f"{API}/projects/{bad}").status_code == 204


def test_damaged_list_of_hashes_stops_no_upload(client: Client) -> None:
    project = client.new_project()
    client.upload(project, "a.jpg", jpeg(0))
    (client.folder(project) / "hashes.json").write_bytes(b"{")
    assert client.upload(project, "b.jpg", jpeg(1)).status_code == 204


@pytest.mark.parametrize("text", ["a\0b", "a\nb", "\ud800", "\x1b[31m"])
def test_text_that_no_program_takes_is_refused_with_a_sentence(client: Client, text: str) -> None:
    import json

    project = client.new_project()
    folder = client.folder(project) / "project" / "gaussians"
    folder.mkdir(parents=True)
    (folder / "scene.ply").touch()
    headers = {"Content-Type": "application/json"}
    for path, body in (
        ("projects", {"title": text}),
        (f"projects/{project}/jobs", {"kind": "segment", "prompt": text}),
        (f"projects/{project}/jobs", {"kind": "segment", "prompt": "vase", "name": text}),
    ):
        answer = client.http.post(f"{API}/{path}", content=json.dumps(body), headers=headers)
        assert answer.status_code == 422 and isinstance(answer.json()["detail"], str), answer.text
    assert client.http.patch(
        f"{API}/projects/{project}", content=json.dumps({"title": text}), headers=headers
    ).status_code == 422  # fmt: skip


def test_new_files_never_change_the_umask_of_other_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from engine.core.files import atomic_write

    old = os.umask(0o027)
    try:
        monkeypatch.setattr(os, "umask", lambda _: pytest.fail("the umask was changed"))
        with atomic_write(tmp_path / "a") as stream:
            stream.write(b"x")
        with atomic_write(tmp_path / "b", private=True) as stream:
            (temporary,) = tmp_path.glob(".writing-*")
            assert temporary.stat().st_mode & 0o077 == 0
    finally:
        monkeypatch.undo()
        os.umask(old)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640
