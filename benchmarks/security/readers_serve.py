"""Readers of the web server's own files, and of what a batch sends to its workers."""

from __future__ import annotations

import functools
import shutil
import tempfile
from pathlib import Path

from .reader import Reader

_USER = "ada"
_PROJECT = "0123456789ab"
_UPLOAD = "0123456789abcdef" * 2


@functools.cache
def _data() -> Path:
    """Return a data folder with a user and a certificate; made once, as keys take time and differ."""
    from engine.serve import Accounts, certificate_files

    folder = Path(tempfile.mkdtemp())
    Accounts(folder).add(_USER)
    certificate_files(folder, ["127.0.0.1"])
    return folder


def _write_data(folder: Path) -> None:
    shutil.copytree(_data(), folder, dirs_exist_ok=True)


def _read_accounts(folder: Path) -> object:
    from engine.serve import Accounts

    accounts = Accounts(folder)
    return accounts.names(), accounts.user_of_session(accounts.new_session(_USER, 1.0)), accounts.user_of_token("x")


def _read_certificate(folder: Path) -> object:
    from engine.serve import certificate_files

    return certificate_files(folder, ["127.0.0.1"])


def _write_project(folder: Path) -> None:
    project = folder / "users" / _USER / "projects" / _PROJECT
    (project / "photos").mkdir(parents=True)
    (project / "info.json").write_text('{"title": "Room", "created": "2026-01-01T00:00:00+00:00"}')
    (project / "hashes.json").write_text('{"a.jpg": "00"}')
    (project / "photos" / "a.jpg").touch()


def _read_project(folder: Path) -> object:
    from engine.serve import Library, ServeSettings

    projects = list(Library(ServeSettings(folder), _USER).projects())
    if not projects:
        return None
    (project,) = projects
    return project.title, project.created, project.known_hashes()


def _write_derived(folder: Path) -> None:
    from engine.core.files import write_json
    from engine.serve import ServeSettings
    from engine.serve.forecasts import _file
    from engine.serve.library import WebProject
    from engine.serve.reports import _STAMP

    _write_project(folder)
    project = WebProject(folder / "users" / _USER / "projects" / _PROJECT)
    project.cache.mkdir()
    # Its name depends on the photos and the settings.
    write_json(_file(project, ServeSettings(folder)), {"seconds": {"preview": [1.0, 2.0, 3.0]}})
    write_json(project.cache / _STAMP, {"made_from": "0123"})


def _read_derived(folder: Path) -> object:
    from engine.serve import ServeSettings
    from engine.serve.forecasts import kept_forecast
    from engine.serve.library import WebProject
    from engine.serve.reports import _stored_key

    project = WebProject(folder / "users" / _USER / "projects" / _PROJECT)
    return kept_forecast(project, ServeSettings(folder)), _stored_key(project)


def _write_upload(folder: Path) -> None:
    from engine.core.files import write_json

    uploads = folder / _USER / "uploads"
    uploads.mkdir(parents=True)
    (uploads / _UPLOAD).write_bytes(b"half")
    known = {"project": _PROJECT, "filename": "a.jpg", "size": 8, "sha256": "00"}
    write_json(uploads / f"{_UPLOAD}.json", known)


def _read_upload(folder: Path) -> object:
    from engine.serve.unfinished import _stored

    return _stored(folder / _USER / "uploads" / f"{_UPLOAD}.json")


def _write_shipped(folder: Path) -> None:
    (folder / "photos").mkdir(parents=True)
    (folder / "photos" / "a.jpg").write_bytes(b"photo")
    (folder / "project").mkdir()
    (folder / "project" / "project.json").write_text("{}")


def _read_shipped(folder: Path) -> object:
    from engine.workers.batch.shipping import pack, pack_photos, unpack

    files = pack(folder / "project", None)
    unpack(files, folder / "copy")
    return len(files), len(pack_photos(folder / "photos", None))


SERVE = (
    Reader("server-upload", _write_upload, _read_upload, (f"{_USER}/uploads/{_UPLOAD}.json",)),
    Reader(
        "server-derived",
        _write_derived,
        _read_derived,
        (f"users/{_USER}/projects/{_PROJECT}/cache/report.json",),
    ),
    Reader("batch-shipping", _write_shipped, _read_shipped, ("photos/a.jpg", "project/project.json")),
    Reader("server-users", _write_data, _read_accounts, ("users.json", "secret.bin")),
    Reader("server-certificate", _write_data, _read_certificate, ("certificate.pem",)),
    Reader(
        "server-project",
        _write_project,
        _read_project,
        tuple(f"users/{_USER}/projects/{_PROJECT}/{name}" for name in ("info.json", "hashes.json")),
    ),
)
