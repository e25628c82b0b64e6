"""Jobs run one after the other, are watched live, and survive the end of the server."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from engine.install.models import find_model_files
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, write_record
from engine.serve import Accounts
from engine.serve.feeds import Feeds
from tests.conftest import wait_until

from .conftest import API, Client, jpeg

Engine = Callable[[str], None]
FOREVER = "while True: time.sleep(0.05)"


@pytest.fixture
def project(client: Client) -> str:
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg())
    return project


def only_process(client: Client) -> Any:
    """Return the process of the job that runs."""
    (job,) = client.http.app.state.server.queue._running.values()  # type: ignore[attr-defined]
    return job._process


def reconstruct(client: Client, project: str) -> Any:
    return client.http.post(f"{API}/projects/{project}/jobs", json={"kind": "reconstruct", "preset": "preview"})


def test_reconstruction_runs_the_engine_on_the_uploaded_photos(client: Client, project: str) -> None:
    assert reconstruct(client, project).status_code == 202
    job = client.wait_for_job(project, "finished")
    assert job["curve"] == [[1.5, 21.5]] and job["label"] == "Reconstruct the scene"
    words = json.loads((client.folder(project) / "project" / "words.json").read_text())
    photos, out = client.folder(project) / "photos", client.folder(project) / "project"
    assert words == ["reconstruct", str(photos), f"--out={out}", "--preset=preview", "--events"]


@pytest.mark.parametrize(
    ("option", "word"),
    [("mask_background", "--mask-background"), ("light", "--light"), ("fisheye", "--lens=OPENCV_FISHEYE")],
)
def test_options_of_a_reconstruction_are_given_to_the_engine(
    client: Client, project: str, option: str, word: str
) -> None:
    wanted = {"kind": "reconstruct", "preset": "preview", option: True}
    assert client.http.post(f"{API}/projects/{project}/jobs", json=wanted).status_code == 202
    client.wait_for_job(project, "finished")
    words = json.loads((client.folder(project) / "project" / "words.json").read_text())
    assert words[-2:] == [word, "--events"]


def test_server_that_is_told_what_to_train_on_tells_the_engine(client: Client, project: str) -> None:
    state = client.http.app.state  # type: ignore[attr-defined]
    state.server = replace(state.server, settings=replace(state.server.settings, device="cpu"))
    reconstruct(client, project)
    client.wait_for_job(project, "finished")
    words = json.loads((client.folder(project) / "project" / "words.json").read_text())
    assert words[-2:] == ["--device=cpu", "--events"]


def test_project_without_photos_is_not_reconstructed(client: Client) -> None:
    answer = reconstruct(client, client.new_project())
    assert (answer.status_code, answer.json()["detail"]) == (409, "Upload photos first.")


def test_second_job_waits_and_both_can_be_stopped(client: Client, project: str, fake_engine: Engine) -> None:
    fake_engine(FOREVER)
    other = client.new_project()
    client.upload(other, "vase.jpg", jpeg())
    reconstruct(client, project)
    running = client.wait_for_job(project, "running")
    waiting = reconstruct(client, other).json()
    assert waiting["state"] == "waiting"
    assert client.http.get(f"{API}/projects/{other}").json()["state"] == "waiting"
    assert reconstruct(client, other).json()["detail"] == "The same job is waiting already."
    assert client.http.delete(f"{API}/projects/{other}/jobs/{waiting['id']}").status_code == 204
    assert client.http.get(f"{API}/projects/{other}").json()["waiting"] == []
    assert client.http.delete(f"{API}/projects/{project}/jobs/{running['id']}").status_code == 204
    stopped = client.wait_for_job(project, "stopped")
    assert (stopped["error"], stopped["message"][:24]) == ("", "What is computed so far ")
    assert client.http.post(f"{API}/projects/{project}/jobs/{stopped['id']}/continue").status_code == 202


def test_jobs_of_several_projects_go_to_a_cluster_at_the_same_time(
    make_client: Callable[..., Client], fake_engine: Engine
) -> None:
    fake_engine(FOREVER)
    client = make_client(scheduler="tcp://head:8786")
    projects = [client.new_project() for _ in range(2)]
    for project in projects:
        client.upload(project, "vase.jpg", jpeg())
        reconstruct(client, project)
    while not all(client.wait_for_job(project, "running")["stage"] for project in projects):
        time.sleep(0.02)
    jobs = [client.wait_for_job(project, "running") for project in projects]
    assert [job["label"] for job in jobs] == ["Reconstruct the scene"] * 2
    words = json.loads((client.folder(projects[1]) / "project" / "words.json").read_text())
    assert words[:5] == ["remote", "--scheduler=tcp://head:8786", "--events", "--", "reconstruct"]
    # Another job of the same project waits.
    video = client.http.post(
        f"{API}/projects/{projects[0]}/jobs", json={"kind": "reconstruct", "preset": "standard"}
    ).json()
    assert video["state"] == "waiting"
    client.http.delete(f"{API}/projects/{projects[0]}/jobs/{video['id']}")
    for project, job in zip(projects, jobs, strict=True):
        client.http.delete(f"{API}/projects/{project}/jobs/{job['id']}")
        client.wait_for_job(project, "stopped")


def test_job_of_a_cluster_is_continued_here_by_a_server_without_one(
    make_client: Callable[..., Client], fake_engine: Engine
) -> None:
    fake_engine("say('error', message='The scheduler does not answer.', error='EnvironmentProblem')")
    client = make_client(scheduler="tcp://head:8786")
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg())
    reconstruct(client, project)
    job = client.wait_for_job(project, "stopped")
    client.stop()
    fake_engine("say('finished', message='done', outputs={})")
    client = make_client()
    client.http.post(f"{API}/projects/{project}/jobs/{job['id']}/continue")
    client.wait_for_job(project, "finished")
    words = json.loads((client.folder(project) / "project" / "words.json").read_text())
    assert words[0] == "reconstruct" and words[-1] == "--events" and "--" not in words


def test_failed_job_tells_its_sentence_and_continues(client: Client, project: str, fake_engine: Engine) -> None:
    fake_engine("say('error', message='Too few photos overlap.', error='CameraError')")
    reconstruct(client, project)
    job = client.wait_for_job(project, "stopped")
    assert job["error"] == "Too few photos overlap."
    fake_engine("say('finished', message='done', outputs={})")
    again = client.http.post(f"{API}/projects/{project}/jobs/{job['id']}/continue")
    assert again.status_code == 202
    client.wait_for_job(project, "finished")
    assert client.http.post(f"{API}/projects/{project}/jobs/{job['id']}/continue").status_code == 409


def test_server_that_ends_leaves_its_job_running_and_the_next_one_finds_it(
    make_client: Callable[..., Client], fake_engine: Engine
) -> None:
    fake_engine("while not (project / 'go').exists(): time.sleep(0.02)\nsay('finished', message='done', outputs={})")
    first = make_client()
    projects = [first.new_project() for _ in range(2)]
    for project in projects:
        first.upload(project, "vase.jpg", jpeg())
        reconstruct(first, project)
    running = first.wait_for_job(projects[0], "running")
    first.stop()
    # Kept until the end, as Python warns when the handle of a process that still runs is dropped.
    process = only_process(first)
    second = make_client()
    for project in projects:
        (second.folder(project) / "project").mkdir(exist_ok=True)
        (second.folder(project) / "project" / "go").touch()
    assert second.wait_for_job(projects[0], "finished")["id"] == running["id"]
    second.wait_for_job(projects[1], "finished")
    for project in projects:
        assert (second.folder(project) / "project" / "runs.txt").read_text() == "reconstruct\n"
    process.wait()


ENDS_TIDILY = """
import os, sys
say('progress', stage='training', fraction=0.6, seconds_left=3.0, message='')
while not os.path.exists(os.environ['GAUSSIAN_HERITAGE_STOP_FILE']): time.sleep(0.02)
say('error', message='Stopped.', error='Cancelled')
sys.exit(130)
"""


def test_server_of_a_container_stops_its_job_tidily_and_the_next_one_continues_it_first(
    make_client: Callable[..., Client], fake_engine: Engine
) -> None:
    fake_engine(ENDS_TIDILY)
    first = make_client(stop_jobs=True)
    projects = [first.new_project() for _ in range(2)]
    for project in projects:
        first.upload(project, "vase.jpg", jpeg())
        reconstruct(first, project)
    while first.wait_for_job(projects[0], "running")["fraction"] < 0.6:
        time.sleep(0.02)
    first.stop()
    events = next((first.folder(projects[0]) / "jobs").glob("*/events.jsonl")).read_text()
    assert '"error": "Cancelled"' in events
    fake_engine("say('finished', message='done', outputs={})")
    second = make_client(stop_jobs=True)
    for project in projects:
        second.wait_for_job(project, "finished")
    runs = [(second.folder(project) / "project" / "runs.txt") for project in projects]
    assert [file.read_text() for file in runs] == ["reconstruct\n" * 2, "reconstruct\n"]
    assert runs[0].stat().st_mtime_ns < runs[1].stat().st_mtime_ns
    second.stop()
    make_client(stop_jobs=True).wait_for_job(projects[0], "finished")
    assert runs[0].read_text() == "reconstruct\n" * 2


def kill_with_server(client: Client, project: str) -> None:
    """End the running job of a project as the end of a container does, when no server is left to notice."""
    client.wait_for_job(project, "running")
    queue = client.http.app.state.server.queue  # type: ignore[attr-defined]
    queue._stop.set()
    queue._thread.join()
    process = only_process(client)
    process.kill()
    process.wait()
    client.stop()


def test_killed_job_is_continued_by_the_next_server_but_not_for_ever(
    make_client: Callable[..., Client], fake_engine: Engine
) -> None:
    fake_engine(FOREVER)
    client = make_client(stop_jobs=True)
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg())
    reconstruct(client, project)
    for _ in range(3):
        kill_with_server(client, project)
        client = make_client(stop_jobs=True)
    # Killed three times in a row: it may be what ends the container.
    assert "stopped unexpectedly" in client.wait_for_job(project, "stopped")["error"]
    again = client.http.get(f"{API}/projects/{project}").json()["job"]
    assert client.http.post(f"{API}/projects/{project}/jobs/{again['id']}/continue").status_code == 202


@pytest.mark.parametrize("ends_unseen", [False, True])
def test_job_that_the_user_stopped_is_not_continued(
    make_client: Callable[..., Client], fake_engine: Engine, ends_unseen: bool
) -> None:
    fake_engine(ENDS_TIDILY)
    client = make_client(stop_jobs=True)
    project = client.new_project()
    client.upload(project, "vase.jpg", jpeg())
    reconstruct(client, project)
    while (job := client.wait_for_job(project, "running"))["fraction"] < 0.6:
        time.sleep(0.02)
    if ends_unseen:
        # The job ends between the queue's last look and the end of the server.
        client.http.app.state.server.queue._step = lambda: None  # type: ignore[attr-defined]
    client.http.delete(f"{API}/projects/{project}/jobs/{job['id']}")
    if ends_unseen:
        client.wait_for_job(project, "stopped")
    client.stop()
    make_client(stop_jobs=True).wait_for_job(project, "stopped")
    assert (client.folder(project) / "project" / "runs.txt").read_text() == "reconstruct\n"


def test_job_has_failed_only_when_it_has_ended(client: Client, project: str, fake_engine: Engine) -> None:
    """Otherwise the page would say that it failed, and offer to stop it."""
    fake_engine("say('error', message='Too few photos overlap.', error='CameraError')\n" + FOREVER)
    reconstruct(client, project)
    events = client.folder(project) / "jobs"
    wait_until(lambda: any('"CameraError"' in file.read_text() for file in events.glob("*/events.jsonl")))
    job = client.wait_for_job(project, "running")
    assert job["error"] == ""
    only_process(client).kill()
    assert client.wait_for_job(project, "stopped")["error"] == "Too few photos overlap."


def test_killed_engine_is_told(client: Client, project: str, fake_engine: Engine) -> None:
    fake_engine("import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    reconstruct(client, project)
    assert "stopped unexpectedly" in client.wait_for_job(project, "stopped")["error"]


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({"prompt": "vase; teapot"}, ["--prompt=vase;teapot"]),
        ({"find_all": True}, ["--all"]),
        ({"background": True}, ["--complement"]),
        ({"detail": True}, ["--detail"]),
        ({"detail": True, "object": "vase"}, ["--detail=vase"]),
        ({"accept": 2}, ["--accept=2"]),
        (
            {
                "clicks": [
                    {"photo": "vase.jpg", "x": 3, "y": 4.5},
                    {"photo": "vase.jpg", "x": 1, "y": 1, "wanted": False},
                ]
            },
            ["--click=vase.jpg=3,4.5", "--not=vase.jpg=1,1"],
        ),
    ],
)
def test_prompts_become_arguments(client: Client, project: str, wanted: dict[str, Any], words: list[str]) -> None:
    scene = client.folder(project) / "project" / "gaussians"
    scene.mkdir(parents=True)
    (scene / "scene.ply").touch()
    record = client.folder(project) / "project" / "objects" / "vase" / "object.json"
    record.parent.mkdir(parents=True)
    write_record(record, ObjectRecord("vase", "vase", {"kind": "click"}, 0.5, 1.0, 1.0, 3, 10), {})
    answer = client.http.post(f"{API}/projects/{project}/jobs", json={"kind": "segment", **wanted})
    assert answer.status_code == 202
    client.wait_for_job(project, "finished")
    written = json.loads((client.folder(project) / "project" / "words.json").read_text())
    assert written == ["segment", str(client.folder(project) / "project"), *words, "--events"]


def refuse_words(project: Path, texts: list[dict[str, str]]) -> None:
    """Store a scene whose last search did not find `texts`."""
    (project / "gaussians").mkdir(parents=True, exist_ok=True)
    (project / "gaussians" / "scene.ply").touch()
    (project / "objects").mkdir(exist_ok=True)
    stored = {"version": 1, "refused": texts, "candidates": []}
    (project / "objects" / "candidates.json").write_text(json.dumps(stored), encoding="utf-8")


def test_offered_model_is_fetched_and_the_refused_words_are_asked_again(client: Client, project: str) -> None:
    folder = client.folder(project) / "project"
    refuse_words(folder, [])
    jobs, wanted = f"{API}/projects/{project}/jobs", {"kind": "segment", "any_word": True}
    refused = client.http.post(jobs, json=wanted)
    assert refused.status_code == 422 and "Ask for a word first" in refused.json()["detail"]
    texts = [{"text": text, "message": "No.", "offer": "clip-vit-b-32"} for text in ("Krug", "bow, and arrow")]
    refuse_words(folder, texts)
    offer = client.http.get(f"{API}/projects/{project}").json()["not_found"]["offer"]
    assert offer["model"] == "clip-vit-b-32" and offer["bytes"] == 155_845_627
    assert offer["licence"].startswith("MIT") and "commercial use included" in offer["users"]
    assert client.http.post(jobs, json=wanted).status_code == 202
    client.wait_for_job(project, "finished")
    words = json.loads((folder / "words.json").read_text())
    assert words[2:] == ['--prompt=Krug;"bow, and arrow"', "--fetch=clip-vit-b-32", "--events"]
    texts[0]["offer"] = texts[1]["offer"] = "clip-of-next-year"
    refuse_words(folder, texts)
    assert client.http.get(f"{API}/projects/{project}").json()["not_found"]["offer"] is None


@pytest.mark.parametrize(
    ("given", "allowed"),
    [({}, True), ({"lan": True}, False), ({"lan": True, "fetch_models": True}, True), ({"fetch_models": False}, False)],
)
def test_owner_decides_whether_users_have_a_model_fetched(
    make_client: Callable[..., Client], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: dict[str, bool],
    allowed: bool,
) -> None:  # fmt: skip
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    token = Accounts(tmp_path / "data").add("ada")
    client = make_client(**given)
    user = "ada" if "lan" in given else "local"
    if user == "ada":
        client.http.headers["Authorization"] = f"Bearer {token}"
    project = client.new_project()
    refuse_words(
        client.folder(project, user) / "project", [{"text": "Krug", "message": "No.", "offer": "clip-vit-b-32"}]
    )
    jobs, wanted = f"{API}/projects/{project}/jobs", {"kind": "segment", "any_word": True}

    def offer() -> dict[str, Any]:
        return dict(client.http.get(f"{API}/projects/{project}").json()["not_found"]["offer"])

    said, answer = offer(), client.http.post(jobs, json=wanted)
    assert not said["stored"] and bool(said["refusal"]) is not allowed
    assert answer.status_code == (202 if allowed else 403)
    if allowed:
        client.wait_for_job(project, "finished")
        return
    assert answer.json()["detail"] == said["refusal"]
    assert (
        "The owner of this server fetches the model that knows any word: python -m engine models fetch clip-vit-b-32"
        in said["refusal"]
    )
    # The owner has fetched it.
    (tmp_path / "cache" / "models").mkdir(parents=True)
    for file in find_model_files("clip-vit-b-32"):
        (tmp_path / "cache" / "models" / file.file).touch()
    assert offer()["stored"] and not offer()["refusal"]
    assert client.http.post(jobs, json=wanted).status_code == 202
    client.wait_for_job(project, "finished")


def test_project_that_learns_gets_the_vocabulary_of_its_user_alone(client: Client, project: str) -> None:
    address, folder = f"{API}/projects/{project}", client.folder(project) / "project"
    assert client.http.put(f"{address}/learning", json={"learns": True}).status_code == 409
    ProjectFolder.create(folder)
    (folder / "gaussians").mkdir()
    (folder / "gaussians" / "scene.ply").touch()
    assert client.http.get(address).json()["learns"] is False
    asked = []
    for learns in (False, True, False):
        assert client.http.put(f"{address}/learning", json={"learns": learns}).status_code == 204
        assert client.http.get(address).json()["learns"] is learns
        client.http.post(f"{address}/jobs", json={"kind": "segment", "find_all": True})
        client.wait_for_job(project, "finished")
        asked.append(json.loads((folder / "words.json").read_text())[2:-1])
    own = client.folder(project).parent.parent / "own_words.json"
    assert asked == [["--all"], ["--all", f"--own-words={own}"], ["--all"]]


def test_server_that_is_told_what_to_render_on_tells_the_engine(client: Client, project: str) -> None:
    state = client.http.app.state  # type: ignore[attr-defined]
    state.server = replace(state.server, settings=replace(state.server.settings, device="gpu"))
    scene = client.folder(project) / "project" / "gaussians"
    scene.mkdir(parents=True)
    (scene / "scene.ply").touch()
    client.http.post(f"{API}/projects/{project}/jobs", json={"kind": "segment", "find_all": True})
    client.wait_for_job(project, "finished")
    words = json.loads((client.folder(project) / "project" / "words.json").read_text())
    assert words[-3:] == ["--all", "--device=gpu", "--events"]


@pytest.mark.parametrize(
    "wanted",
    [
        {},
        {"prompt": "vase", "find_all": True},
        {"prompt": "vase", "detail": True},
        {"prompt": "vase", "any_word": True},
        {"detail": True, "object": "../../secret"},
        {"detail": True, "object": "cube"},
        {"prompt": "x" * 600},
        {"clicks": [{"photo": "other.jpg", "x": 1, "y": 1}]},
        {"clicks": [{"photo": "vase.jpg", "x": 1, "y": 1, "wanted": False}]},
        {"clicks": [{"photo": "vase.jpg", "x": "NaN", "y": 1}]},
        {"clicks": [{"photo": "vase.jpg", "x": 1, "y": 1}], "object": "../../secret"},
    ],
)
def test_prompts_that_mean_nothing_are_refused(client: Client, project: str, wanted: dict[str, Any]) -> None:
    scene = client.folder(project) / "project" / "gaussians"
    scene.mkdir(parents=True)
    (scene / "scene.ply").touch()
    answer = client.http.post(f"{API}/projects/{project}/jobs", json={"kind": "segment", **wanted})
    assert answer.status_code in (415, 422) and isinstance(answer.json()["detail"], str)


def test_jobs_of_a_user_are_limited(make_client: Callable[..., Client], fake_engine: Engine) -> None:
    fake_engine(FOREVER)
    client = make_client(max_waiting=1)
    projects = [client.new_project() for _ in range(3)]
    for project in projects:
        client.upload(project, "vase.jpg", jpeg())
    reconstruct(client, projects[0])
    client.wait_for_job(projects[0], "running")
    assert [reconstruct(client, project).status_code for project in projects[1:]] == [202, 409]
    for project in projects[:2]:
        assert client.http.delete(f"{API}/projects/{project}").status_code == 204
    assert len(list((client.data / "users" / "local" / "trash").iterdir())) == 2


def test_deleted_project_stops_its_job(client: Client, project: str, fake_engine: Engine) -> None:
    fake_engine("(project / 'pid').write_text(str(__import__('os').getpid()))\n" + FOREVER)
    reconstruct(client, project)
    client.wait_for_job(project, "running")
    file = client.folder(project) / "project" / "pid"
    while not file.exists():
        time.sleep(0.02)
    pid = int(file.read_text())
    client.http.delete(f"{API}/projects/{project}")
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_stream_sends_what_was_missed_and_then_what_happens() -> None:
    async def watch() -> list[str]:
        feeds, project = Feeds(), Path("room")
        feeds.publish(project, "job", '{"old": 1}')
        feeds.publish(project, "job", '{"new": 1}')
        stream = feeds.stream(project, 0)
        seen = [await anext(stream), await anext(stream)]
        number = int(seen[1].partition("id: ")[2].partition("\n")[0])
        feeds.publish(project, "photos")
        seen.append(await anext(stream))
        await stream.aclose()
        again = feeds.stream(project, number)
        seen += [await anext(again), await anext(again)]
        await again.aclose()
        assert feeds._watchers == {}
        return seen

    retry, job, photos, _, missed = asyncio.run(watch())
    assert retry.startswith("retry:") and '{"new": 1}' in job and "event: photos" in photos and missed == photos
