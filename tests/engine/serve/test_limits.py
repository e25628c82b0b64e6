"""Large, slow and broken requests end with a sentence, and no details of the server leave it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from engine.serve import ServeSettings, library
from engine.serve.access import CLAIM
from engine.serve.guards import RequestLimits

from .conftest import API, Client


def test_large_body_is_refused(client: Client) -> None:
    answer = client.http.post(f"{API}/projects", json={"title": "x" * (2 << 20)})
    assert answer.status_code == 413 and "larger than" in answer.json()["detail"]


@pytest.mark.parametrize("body", [b"{", b"[]", b'{"title": ""}', b'{"title": 5}', b"\xff"])
def test_broken_body_is_one_sentence(client: Client, body: bytes) -> None:
    answer = client.http.post(f"{API}/projects", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (400, 422) and isinstance(answer.json()["detail"], str)


def test_error_of_ours_shows_no_stack_trace(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError("a secret detail")

    monkeypatch.setattr(library.Library, "create", fails)
    answer = client.http.post(f"{API}/projects", json={"title": "x"})
    assert answer.status_code == 500
    assert answer.json() == {"detail": "The server failed. Its log has the details; try again."}


def test_paths_of_the_server_are_not_told(client: Client) -> None:
    project = client.new_project()
    answer = client.http.get(f"{API}/projects/{project}/cameras")
    assert answer.status_code >= 400 and str(client.data) not in answer.text


def _call(limits: RequestLimits, messages: list[Any], headers: list[tuple[bytes, bytes]]) -> list[Any]:
    sent: list[Any] = []

    async def receive() -> Any:
        if not messages:
            await asyncio.sleep(60)
        return messages.pop(0)

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "method": "POST", "path": f"{API}/projects", "headers": headers}
    asyncio.run(limits(scope, receive, send))
    return sent


async def _reads_all(scope: Any, receive: Any, send: Any) -> None:
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": []})


def test_slow_client_is_given_up(tmp_path: Path) -> None:
    limits = RequestLimits(_reads_all, ServeSettings(tmp_path, read_seconds=0.05))
    first = {"type": "http.request", "body": b"{", "more_body": True}
    assert _call(limits, [first], [])[0]["status"] == 408


def test_upload_that_trickles_is_given_up(tmp_path: Path) -> None:
    limits = RequestLimits(_reads_all, ServeSettings(tmp_path, read_seconds=0.05, min_upload_rate=1e9))
    sent: list[Any] = []

    async def trickle() -> Any:
        # Never a pause that is too long.
        await asyncio.sleep(0.01)
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "method": "PATCH", "path": f"{API}/uploads/x", "headers": []}
    asyncio.run(asyncio.wait_for(limits(scope, trickle, send), 60))
    assert sent[0]["status"] == 408


def test_user_has_only_so_many_requests_at_a_time(tmp_path: Path) -> None:
    claims: list[bool] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        claims.append(scope[CLAIM]("ada"))
        if len(claims) < 4:
            await limits(dict(scope), receive, send)
        await send({"type": "http.response.start", "status": 200, "headers": []})

    limits = RequestLimits(app, ServeSettings(tmp_path, max_user_requests=3))
    _call(limits, [], [])
    assert claims == [True, True, True, False]
    claims.clear()
    _call(limits, [], [])
    assert claims == [True, True, True, False]


def test_body_without_a_stated_length_is_limited_too(tmp_path: Path) -> None:
    limits = RequestLimits(_reads_all, ServeSettings(tmp_path, max_body_bytes=10))
    part = {"type": "http.request", "body": b"x" * 8, "more_body": True}
    assert _call(limits, [dict(part), dict(part), dict(part)], [])[0]["status"] == 408


@pytest.mark.parametrize("length", [b"-1", b"x", b"9" * 30])
def test_impossible_length_is_refused(tmp_path: Path, length: bytes) -> None:
    limits = RequestLimits(_reads_all, ServeSettings(tmp_path))
    assert _call(limits, [], [(b"content-length", length)])[0]["status"] == 413


def test_projects_are_limited(make_client: Callable[..., Client]) -> None:
    client = make_client(max_projects=1)
    client.new_project()
    answer = client.http.post(f"{API}/projects", json={"title": "x"})
    assert answer.status_code == 409 and "which is the limit" in answer.json()["detail"]


def test_page_and_api_are_served_without_a_listing(client: Client) -> None:
    http: TestClient = client.http
    assert http.get("/").status_code == 200
    for path in ("/users.json", "/../secret", "/%2e%2e/secret", "/api/v1/nothing"):
        assert http.get(path).status_code in (401, 404)
