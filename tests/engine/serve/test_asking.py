"""Words are asked of a scene while it is trained, and the answer comes with its pictures."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import ProjectError
from engine.serve import asking, engine_call

from .conftest import API, Client

PICTURE = b"a picture"


def test_answer_shows_what_was_found_and_says_why_the_rest_was_not(
    client: Client, project: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def engine(arguments: list[str], what: str, **_: str) -> dict[str, Any]:
        asked.append(arguments)
        folder = Path(next(one for one in arguments if one.startswith("--out=")).removeprefix("--out="))
        (folder / "1.png").write_bytes(PICTURE)
        found = [{"text": "vase", "photo": "a.jpg", "picture": str(folder / "1.png")}]
        return {"step": 500, "found": found, "refused": {"ghost": "Nothing looks like it."}}

    monkeypatch.setattr(asking, "call_engine", engine)
    answer = client.http.post(f"{API}/projects/{project}/ask", json={"prompt": "vase, ghost"})
    assert answer.status_code == 200
    assert asked[0][0] == "ask" and asked[0][2] == "--prompt=vase, ghost"
    (found,) = answer.json()["found"]
    assert found["picture"] == f"data:image/png;base64,{base64.b64encode(PICTURE).decode()}"
    assert answer.json()["refused"] == {"ghost": "Nothing looks like it."} and answer.json()["step"] == 500


def test_question_that_cannot_be_answered_is_a_sentence(
    client: Client, project: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def engine(arguments: list[str], what: str, **_: str) -> dict[str, Any]:
        raise ProjectError("The scene has no shape yet that could be asked. Ask again in a minute.")

    monkeypatch.setattr(asking, "call_engine", engine)
    answer = client.http.post(f"{API}/projects/{project}/ask", json={"prompt": "vase"})
    assert answer.status_code == 409 and answer.json()["detail"].startswith("The scene has no shape yet")
    for prompt in (" ", ",", "vase" * 1000, "vase, cup, drum, globe, lamp, bust"):
        answer = client.http.post(f"{API}/projects/{project}/ask", json={"prompt": prompt})
        assert answer.status_code == 422
    assert answer.json()["detail"] == "A question has at most 5 texts. Ask for fewer things."


def test_question_that_takes_too_long_is_answered_with_what_helps(
    client: Client, project: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine_call, "_MAX_SECONDS", 0)
    answer = client.http.post(f"{API}/projects/{project}/ask", json={"prompt": "vase"})
    assert answer.json()["detail"] == "The answer took more than 0 seconds. Ask for fewer things."


def test_refusal_of_the_engine_is_no_fault_of_the_server(client: Client, project: str) -> None:
    answer = client.http.post(f"{API}/projects/{project}/ask", json={"prompt": "vase"})
    assert answer.status_code == 409 and "the server" in answer.json()["detail"]
