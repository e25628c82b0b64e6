"""pip installs only what has its hash, asks only the index that is wanted, and can be stopped."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from engine.core.errors import Cancelled, EnvironmentProblem
from engine.core.system import python_in
from engine.install.environment import Pip, locked_arguments
from engine.install.environment.pip_command import NotTrusted, run_logged
from tests.engine.install.models.site import CERTIFICATE, running_site

from .conftest import locked


@pytest.fixture
def pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Pip:
    monkeypatch.setenv("PIP_DRY_RUN", "1")
    return Pip(Path(sys.executable), tmp_path / "log")


def test_file_with_another_hash_is_not_installed(pip: Pip, wheels: Path, tmp_path: Path) -> None:
    pip.install(locked_arguments(locked(wheels, "our_package")))
    assert "Would install our-package-1.0" in (tmp_path / "log").read_text(encoding="utf-8")
    with pytest.raises(EnvironmentProblem, match="pip could not install"):
        pip.install(locked_arguments(locked(wheels, "our_package", "0" * 64)))


def test_index_on_the_command_line_is_the_only_one_asked(
    pip: Pip, wheels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PIP_NO_INDEX")
    monkeypatch.delenv("PIP_DRY_RUN")
    (tmp_path / "index" / "our-package").mkdir(parents=True)
    (tmp_path / "index" / "our-package" / "index.html").write_text("<html></html>")
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", wheels.as_uri())
    arguments = ["--index-url", (tmp_path / "index").as_uri(), "our-package==1.0"]
    assert pip.offered(arguments) is not None
    assert pip.offered(arguments, one_index=True) is None


def test_folder_of_wheels_takes_the_place_of_every_index(
    wheels: Path, empty: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("FIND_LINKS", "NO_INDEX"):
        monkeypatch.delenv(f"PIP_{name}")
    shutil.copytree(empty, tmp_path / "environment", symlinks=True)
    python = python_in(tmp_path / "environment")
    Pip(python, tmp_path / "log", wheels=wheels).install(["our-package"])
    run_logged([python, "-c", "import our_package"], tmp_path / "log", "not installed")


def test_failure_tells_the_line_that_names_the_error(tmp_path: Path) -> None:
    code = "import sys; print('ERROR: the shelf is empty'); print('bye'); sys.exit(1)"
    with pytest.raises(EnvironmentProblem, match=r"^It failed: ERROR: the shelf is empty \(details: .*log\)\.$"):
        run_logged([sys.executable, "-c", code], tmp_path / "log", "It failed")


def test_program_is_ended_when_the_user_stops(tmp_path: Path) -> None:
    lines: list[str] = []
    code = "print('started', flush=True); import time; time.sleep(600); print('still here')"
    with pytest.raises(Cancelled):
        run_logged(
            [sys.executable, "-c", code], tmp_path / "log", "", on_line=lines.append, should_stop=lambda: bool(lines)
        )
    assert lines == ["started\n"]


def test_missing_program_is_told(tmp_path: Path) -> None:
    with pytest.raises(EnvironmentProblem, match="could not be started"):
        run_logged([tmp_path / "nothing"], tmp_path / "log", "")


@pytest.mark.parametrize(
    "words",
    [
        "1, '[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed: self-signed certificate (_ssl.c:1006)'",
        # Of Windows, in the language of the user.
        "'Eine Zertifikatkette endete mit einem Stammzertifikat, das nicht als vertrauenswürdig gilt.'",
    ],
)
def test_refused_certificate_is_recognised_in_each_language(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cause = f"(Caused by SSLError(SSLCertVerificationError({words})))"
    line = f"HTTPSConnectionPool(host='pypi.org', port=443): Max retries exceeded with url: /simple/ {cause} - skipping"
    code = f"import sys; print({line!r}); print('ERROR: No matching distribution found'); sys.exit(1)"
    with pytest.raises(NotTrusted, match="No matching distribution found") as told:
        run_logged([sys.executable, "-X", "utf8", "-c", code], tmp_path / "log", "It failed")
    assert (told.value.host, told.value.port) == ("pypi.org", 443)
    answer = subprocess.CompletedProcess([], 1, stdout="", stderr=line)
    monkeypatch.setattr("engine.install.environment.pip_command.run_text", lambda *_, **__: answer)
    with pytest.raises(NotTrusted):
        Pip(Path(sys.executable), tmp_path / "log").offered(["our-package"])


@pytest.mark.parametrize("trusted", [False, True])
def test_certificate_that_pip_refuses_is_told_with_its_server(
    pip: Pip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trusted: bool
) -> None:
    for name, value in {"RETRIES": "0", "CONFIG_FILE": os.devnull, "DISABLE_PIP_VERSION_CHECK": "1"}.items():
        monkeypatch.setenv(f"PIP_{name}", value)
    # The last two count more for pip than its own setting.
    for name in ("PIP_CERT", "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE"):
        monkeypatch.delenv(name, raising=False)
    if trusted:
        monkeypatch.setenv("SSL_CERT_FILE", str(CERTIFICATE))
    with running_site(b"<html></html>") as site:
        arguments = ["--index-url", f"https://127.0.0.1:{site.port}/simple", "our-package"]
        if trusted:
            assert pip.offered(arguments) is None
        for ask in (pip.install, *(() if trusted else (pip.offered,))):
            with pytest.raises(EnvironmentProblem) as told:
                ask(arguments)
            assert isinstance(told.value, NotTrusted) is not trusted
            if isinstance(told.value, NotTrusted):
                # A quiet pip does not always name it.
                named = (told.value.host, told.value.port) == ("127.0.0.1", site.port)
                assert named or (ask == pip.offered and not told.value.host)
        assert bool(site.requests) == trusted
