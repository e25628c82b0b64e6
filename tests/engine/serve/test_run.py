"""The server as a program: where it listens, that only one works with its data, and what it does when it is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.core.errors import EnvironmentProblem, ProjectError, SettingsError
from engine.core.events import ignore_events
from engine.serve import Accounts, ServeSettings, check_server, run, run_server
from engine.serve.certificate import certificate_files
from tests.conftest import PATIENCE, ROOT


def test_server_says_where_it_is_and_ends_when_asked(start: Callable[..., tuple[subprocess.Popen[str], str]]) -> None:
    process, address = start()
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address) as answer:
        assert b"Gaussian Heritage" in answer.read()
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0


def test_killed_server_leaves_nothing_locked(start: Callable[..., tuple[subprocess.Popen[str], str]]) -> None:
    process, _ = start()
    process.send_signal(signal.SIGKILL)
    process.wait()
    _, address = start()
    with urllib.request.urlopen(f"{address}api/v1/session") as answer:
        assert answer.status == 200


def test_second_server_on_the_same_data_is_refused_and_a_taken_port_told(
    start: Callable[..., tuple[subprocess.Popen[str], str]], tmp_path: Path, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, address = start()
    monkeypatch.setattr(run, "PAGE", page)
    with pytest.raises(ProjectError, match="Another server works with"):
        run_server(ServeSettings(tmp_path / "data", port=0), ignore_events, lambda: True)
    port = int(address.rstrip("/").rpartition(":")[2])
    with pytest.raises(SettingsError, match=f"Port {port} cannot be used"):
        run_server(ServeSettings(tmp_path / "other", port=port), ignore_events, lambda: True)


def test_network_needs_a_user_and_gets_tls(
    start: Callable[..., tuple[subprocess.Popen[str], str]], tmp_path: Path, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "PAGE", page)
    settings = ServeSettings(tmp_path / "data", port=0, lan=True)
    with pytest.raises(SettingsError, match="Add a user first"):
        run_server(settings, ignore_events, lambda: True)
    Accounts(tmp_path / "data").add("ada")
    _, address = start("--lan")
    assert address.startswith("https://")
    assert (tmp_path / "data" / "private_key.pem").stat().st_mode & 0o077 == 0


def test_certificate_is_kept_until_the_addresses_change(tmp_path: Path) -> None:
    certificate, key = certificate_files(tmp_path, ["127.0.0.1", "room.local"])
    first = certificate.read_bytes()
    assert certificate_files(tmp_path, ["127.0.0.1", "room.local"]) == (certificate, key)
    assert certificate.read_bytes() == first
    certificate_files(tmp_path, ["127.0.0.1"])
    assert certificate.read_bytes() != first


def test_page_that_is_not_built_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "PAGE", tmp_path)
    with pytest.raises(EnvironmentProblem, match="make serve"):
        run_server(ServeSettings(tmp_path / "data"), ignore_events, lambda: True)


def test_server_starts_without_torch() -> None:
    code = "import sys, engine.serve.app; print([m for m in ('torch', 'cv2', 'pycolmap', 'numba') if m in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "[]"


def test_first_user_is_told_once_and_the_health_check_follows_the_server(
    start: Callable[..., tuple[subprocess.Popen[str], str]], tmp_path: Path
) -> None:
    options = ("--lan", "--name=museum.test", "--first-user=ada")
    process, address = start(*options)
    assert address.startswith("https://museum.test:")
    assert "The token of ada, shown only now: " in (tmp_path / "said.txt").read_text()
    settings = ServeSettings(tmp_path / "data", port=int(address.rstrip("/").rpartition(":")[2]), lan=True)
    check_server(settings)
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0
    with pytest.raises(EnvironmentProblem, match="does not answer"):
        check_server(settings)
    start(*options)
    assert "token" not in (tmp_path / "said.txt").read_text()
