"""Exports, streams and jobs of some keep the others going; what a job runs is our engine."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import HeritageError
from engine.project.folder import ProjectFolder
from engine.serve import downloads, feeds
from engine.serve.feeds import Feeds
from engine.serve.job_queue import JobQueue
from engine.serve.library import WebProject
from engine.serve.settings import ServeSettings
from engine.serve.streams import Streams
from tests.conftest import wait_until

from .conftest import API, Client


def with_scene(client: Client) -> str:
    project = client.new_project()
    ProjectFolder.create(client.folder(project) / "project")
    folder = client.folder(project) / "project" / "gaussians"
    folder.mkdir()
    (folder / "scene.ply").touch()
    return project


def test_many_exports_at_once_keep_nobody_else_waiting(
    make_client: Callable[..., Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    client = make_client(max_user_exports=45)
    projects = [with_scene(client) for _ in range(46)]
    go_on, n_made = threading.Event(), []

    def slow(project: WebProject, *rest: Any) -> None:
        n_made.append(project)
        go_on.wait(60)
        rest[-1].write_bytes(b"ply")

    monkeypatch.setattr(downloads, "_export", slow)
    with ThreadPoolExecutor(46) as pool:
        asked = [pool.submit(client.http.get, f"{API}/projects/{one}/export?format=ply") for one in projects]
        # One more than may wait.
        wait_until(lambda: any(one.done() for one in asked))
        assert len(n_made) == 1 and client.http.get(f"{API}/projects").status_code == 200
        go_on.set()
        answers = sorted((one.result() for one in asked), key=lambda answer: answer.status_code)
    assert [answer.status_code for answer in answers] == [200] * 45 + [429]
    refused = "45 of your exports and questions are under way. Try again later."
    assert answers[-1].json()["detail"] == refused


def test_export_runs_our_engine_whatever_lies_in_the_current_folder(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = tmp_path / "mounted" / "engine"
    hostile.mkdir(parents=True)
    (hostile / "__init__.py").write_text("")
    (hostile / "__main__.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(hostile.parent)
    with pytest.raises(HeritageError):
        downloads.export(WebProject(client.folder(with_scene(client))), None, "ply")
    assert not (tmp_path / "ran").exists()


def test_job_takes_no_module_from_the_folder_that_it_runs_in(
    client: Client, fake_engine: Callable[[str], None]
) -> None:
    fake_engine("say('finished', message=f'safe path: {sys.flags.safe_path}', outputs={})")
    project = client.new_project()
    (client.folder(project) / "photos" / "a.jpg").touch()
    client.http.post(f"{API}/projects/{project}/jobs", json={"kind": "reconstruct"})
    assert client.wait_for_job(project, "finished")["message"] == "safe path: True"


def test_job_that_cannot_be_started_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    queue = JobQueue(tmp_path, Feeds())
    monkeypatch.setattr(queue, "_command", lambda arguments: ("python", "\0"))
    project = WebProject(tmp_path / "users" / "local" / "projects" / ("0" * 12))
    project.folder.mkdir(parents=True)
    queue.start()
    try:
        queue.submit(project, ["reconstruct", "\0"])
        wait_until(lambda: queue.last(project.folder) is not None)
        view = queue.last(project.folder)
        assert view is not None and view.state == "stopped" and "could not be started" in view.error
    finally:
        queue.stop()


def test_clock_that_is_set_back_stops_no_events(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [2_000_000_000_000_000_000]
    monkeypatch.setattr(feeds.time, "time_ns", lambda: clock[0])

    async def watch() -> list[str]:
        project, of_before = Path("room"), Feeds()
        of_before.publish(project, "photos")
        stream = of_before.stream(project, 0)
        seen = [await anext(stream), await anext(stream)]
        number = int(seen[1].partition("id: ")[2].partition("\n")[0])
        clock[0] -= 3_600_000_000_000
        of_before.publish(project, "objects")
        seen.append(await asyncio.wait_for(anext(stream), 60))
        # The next server, whose clock is behind too.
        after = Feeds()
        after.publish(project, "scene")
        again = after.stream(project, number)
        await anext(again)
        seen.append(await asyncio.wait_for(anext(again), 60))
        return seen

    _, photos, objects, scene = asyncio.run(watch())
    assert "event: photos" in photos and "event: objects" in objects and "event: scene" in scene


def test_streams_of_a_browser_leave_connections_for_other_requests(tmp_path: Path) -> None:
    async def open_many() -> tuple[list[list[str]], int]:
        project = WebProject(tmp_path / "users" / "ada" / "projects" / ("0" * 12))
        streams = Streams(ServeSettings(tmp_path, max_browser_streams=3), Feeds())
        bodies = [streams.begin(project, "ada", "", browser).body_iterator for browser in ("b", "b", "b", "b", "other")]
        seen = [[str(await anext(body))] for body in bodies]  # type: ignore[call-overload]
        # The first has made room for the fourth.
        seen[0] += [str(text) async for text in bodies[0]]
        n_open = streams._of_user["ada"]
        for body in bodies[1:]:
            await body.aclose()  # type: ignore[union-attr]
        assert not streams._of_browser
        return seen, n_open

    seen, n_open = asyncio.run(open_many())
    assert "event: displaced" in seen[0][-1] and [len(texts) for texts in seen[1:]] == [1] * 4 and n_open == 4
