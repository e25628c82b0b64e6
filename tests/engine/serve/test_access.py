"""Nobody reaches what is not theirs: tokens, cookies, other sites' pages, other users' projects."""

from __future__ import annotations

import logging
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from engine.core.errors import SettingsError
from engine.serve import Accounts, certificate_files

from .conftest import API, Client, jpeg


@pytest.fixture
def two_users(make_client: Callable[..., Client], tmp_path: Path) -> tuple[Client, str, str]:
    """A server of a network, and the tokens of two users."""
    accounts = Accounts(tmp_path / "data")
    ada, bob = accounts.add("ada"), accounts.add("bob")
    client = make_client(lan=True)
    client.http.base_url = "https://testserver"  # type: ignore[assignment]
    return client, ada, bob


def sign_in(http: TestClient, token: str) -> int:
    answer = http.post(f"{API}/session", json={"token": token})
    http.headers["X-CSRF-Token"] = answer.json().get("csrf", "")
    return answer.status_code


def test_page_of_this_computer_needs_no_token(client: Client) -> None:
    assert client.http.get(f"{API}/session").json()["user"] == "local"
    assert client.http.get(f"{API}/projects").json() == []


def test_every_route_but_the_session_needs_a_user(two_users: tuple[Client, str, str]) -> None:
    http = two_users[0].http
    paths = http.get(f"{API}/openapi.json").json()["paths"]
    assert len(paths) > 15
    for path, methods in paths.items():
        for method in methods:
            if path == f"{API}/session" and method in ("get", "post"):
                continue
            filled = path.replace("{project_id}", "0" * 12).replace("{uuid}", "0" * 32).replace("{number}", "1")
            answer = http.request(method, filled, headers={"Tus-Resumable": "1.0.0"})
            assert answer.status_code == 401, (method, path, answer.text)


def test_token_signs_in_and_out(two_users: tuple[Client, str, str]) -> None:
    client, ada, _ = two_users
    assert client.http.get(f"{API}/session").json()["user"] is None
    assert sign_in(client.http, "wrong") == 401
    assert sign_in(client.http, ada) == 200
    assert client.http.get(f"{API}/session").json()["user"] == "ada"
    cookie = next(one for one in client.http.cookies.jar if one.name.startswith("session"))
    assert cookie.secure and cookie.has_nonstandard_attr("HttpOnly")
    assert client.http.delete(f"{API}/session").status_code == 204
    assert client.http.get(f"{API}/projects").status_code == 401
    # A copy of the cookie is worthless too, also to the next server.
    client.http.cookies.set(cookie.name, str(cookie.value), domain="testserver.local", path="/")
    assert client.http.get(f"{API}/projects").status_code == 401
    assert Accounts(client.data).user_of_session(str(cookie.value)) is None


def test_projects_of_others_cannot_be_seen_changed_or_guessed(two_users: tuple[Client, str, str]) -> None:
    client, ada, bob = two_users
    sign_in(client.http, ada)
    project = client.new_project("secret")
    client.upload(project, "vase.jpg", jpeg())
    sign_in(client.http, bob)
    assert client.http.get(f"{API}/projects").json() == []
    missing = client.http.get(f"{API}/projects/{'0' * 12}")
    for path in ("", "/photos/vase.jpg", "/cameras", "/scene.ply", "/events", "/report"):
        answer = client.http.get(f"{API}/projects/{project}{path}")
        assert (answer.status_code, answer.json()) == (404, missing.json())
    assert client.http.delete(f"{API}/projects/{project}").status_code == 404
    assert client.begin(project, "vase.jpg", 1000).status_code == 404


def test_unfinished_upload_of_another_user_is_not_found(two_users: tuple[Client, str, str]) -> None:
    client, ada, bob = two_users
    sign_in(client.http, ada)
    location = client.begin(client.new_project(), "vase.jpg", 1000).headers["location"]
    sign_in(client.http, bob)
    assert client.send(location, b"x").status_code == 404
    assert client.http.delete(location, headers={"Tus-Resumable": "1.0.0"}).status_code == 404


def test_changing_request_of_another_site_is_refused(client: Client) -> None:
    for token in ("", "wrong"):
        client.http.headers["X-CSRF-Token"] = token
        assert client.http.post(f"{API}/projects", json={"title": "x"}).status_code == 403
    assert client.http.get(f"{API}/projects").json() == []


def test_script_uses_its_token_without_cookies(two_users: tuple[Client, str, str]) -> None:
    client, ada, _ = two_users
    client.http.headers.clear()
    headers = {"Authorization": f"Bearer {ada}"}
    assert client.http.post(f"{API}/projects", json={"title": "x"}, headers=headers).status_code == 201
    assert client.http.get(f"{API}/projects", headers={"Authorization": "Bearer x"}).status_code == 401


def test_name_that_leads_to_this_computer_is_refused(client: Client) -> None:
    assert client.http.get(f"{API}/session", headers={"Host": "evil.example"}).status_code == 400


def test_tokens_are_stored_as_hashes_and_never_logged(
    two_users: tuple[Client, str, str], caplog: pytest.LogCaptureFixture
) -> None:
    client, ada, _ = two_users
    with caplog.at_level(logging.DEBUG):
        sign_in(client.http, ada)
    assert ada not in caplog.text
    for file in client.data.rglob("*"):
        assert not file.is_file() or ada.encode() not in file.read_bytes()
    assert stat.S_IMODE((client.data / "secret.bin").stat().st_mode) == 0o600


def test_new_token_ends_the_sessions_of_the_old_one(two_users: tuple[Client, str, str]) -> None:
    client, ada, _ = two_users
    sign_in(client.http, ada)
    again = Accounts(client.data).add("ada")
    assert client.http.get(f"{API}/projects").status_code == 401
    assert sign_in(client.http, ada) == 401 and sign_in(client.http, again) == 200
    Accounts(client.data).remove("ada")
    assert client.http.get(f"{API}/projects").status_code == 401


def test_two_servers_of_a_computer_have_cookies_of_their_own(tmp_path: Path) -> None:
    first, second = Accounts(tmp_path / "a"), Accounts(tmp_path / "b")
    assert first.cookie_name != second.cookie_name == Accounts(tmp_path / "b").cookie_name


def test_code_of_the_address_signs_in_once(two_users: tuple[Client, str, str]) -> None:
    client = two_users[0]
    accounts: Accounts = client.http.app.state.server.accounts  # type: ignore[attr-defined]
    code = accounts.new_code("ada")
    assert sign_in(client.http, code) == 200 and client.http.get(f"{API}/session").json()["user"] == "ada"
    assert sign_in(client.http, code) == 401


def test_secrets_are_nobody_elses_from_their_first_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    modes = []
    real = os.open

    def noting(path: Any, flags: int, mode: int = 0o777, **rest: Any) -> int:
        modes.append(mode)
        return real(path, flags, mode, **rest)

    monkeypatch.setattr(os, "open", noting)
    Accounts(tmp_path).add("ada")
    certificate_files(tmp_path, ["127.0.0.1"])
    # The certificate is for everybody, and opened otherwise.
    assert modes == [0o600] * 3


def test_session_outlives_the_server_and_expires(tmp_path: Path) -> None:
    accounts = Accounts(tmp_path)
    accounts.add("ada")
    cookie, expired = accounts.new_session("ada", 1.0), accounts.new_session("ada", -1.0)
    assert Accounts(tmp_path).user_of_session(cookie) == "ada"
    assert Accounts(tmp_path).user_of_session(expired) is None


@pytest.mark.parametrize("cookie", ["", "ada", "ada.99999999999", "ada.99999999999.00", "local.1.é", ".."])
def test_forged_session_is_nobody(tmp_path: Path, cookie: str) -> None:
    assert Accounts(tmp_path).user_of_session(cookie) is None


@pytest.mark.parametrize("name", ["", "local", "Ada", "a b", "../a", "x" * 33])
def test_names_that_are_no_users_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(SettingsError, match="cannot be the name of a user"):
        Accounts(tmp_path).add(name)


def test_browsers_are_told_what_a_page_may_do(client: Client) -> None:
    headers = client.http.get("/").headers
    assert "script-src 'self'" in headers["content-security-policy"]
    assert "unsafe-inline" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
