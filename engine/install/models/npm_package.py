"""Downloads a package of the npm registry, or of a mirror, without npm: its description by HTTPS, then its file.

The protocol: ``GET <registry>/<name>`` describes all versions; ``dist`` of a version has the address and the hash of
its file.
"""

from __future__ import annotations

import base64
import hashlib
import http.client
import urllib.error
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from ...core.errors import Cancelled, EnvironmentProblem, FormatError, HeritageError, ModelFileError
from ...core.events import StopCheck
from ...core.files import atomic_write, check, optional, parse_json
from ...core.https import open_https
from .cache import OFFLINE_VARIABLE
from .npm_settings import NpmSettings, read_npm_settings

_CHUNK = 1 << 18
_MAX_DESCRIPTION = 8 << 20
_SHORT_DESCRIPTION = "application/vnd.npm.install-v1+json; q=1.0, application/json; q=0.8"
_SCHEMA = {"versions": {str: dict}}
_DIST = {"dist": {"tarball": str, "integrity": optional((str, None)), "shasum": optional((str, None))}}
_ADVICE = "Check which registry npm's settings name on this computer."
_STRONG = ("sha512", "sha384", "sha256")


def fetch_npm_package(package: str, folder: Path, *, max_bytes: int, should_stop: StopCheck) -> Path:
    """Download ``name@version`` into `folder` and return its file, a gzipped tar.

    Parameters
    ----------
    max_bytes : int
        A larger file is refused.
    should_stop : StopCheck
        Called about four times per megabyte.

    Raises
    ------
    EnvironmentProblem
        When the registry cannot be reached, refuses, or does not have the package.
    ModelFileError
        When the file has another hash than the registry states, or is too large.
    FormatError
        When npm's settings or the registry's answer cannot be read.
    DiskError
        When `folder` cannot be written.
    Cancelled
        When `should_stop` returned True.
    """
    name, _, version = package.rpartition("@")
    settings = read_npm_settings()
    registry = settings.registry_of(name)
    url = registry + quote(name, safe="@")
    try:
        with _opened(url, settings, _SHORT_DESCRIPTION) as answer:
            text = answer.read(_MAX_DESCRIPTION + 1)
        if len(text) > _MAX_DESCRIPTION:
            raise ModelFileError(f"{url} describes more than any package has. {_ADVICE}")
        dist = _dist(text, url, version)
        file = folder / f"{name.rpartition('/')[2]}-{version}.tgz"
        with _opened(settings.tarball_url(dist["tarball"], registry), settings, "*/*") as answer:
            _store(answer, file, dist, max_bytes, should_stop)
    except HeritageError:
        raise
    except urllib.error.HTTPError as error:
        why = f"{error.url} answers {error.code} ({error.reason})"
        error.close()
        raise _unreachable(package, why) from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        why = str(getattr(error, "reason", None) or error) or type(error).__name__
        raise _unreachable(package, f"{registry}: {why}") from error
    return file


def _unreachable(package: str, why: str) -> EnvironmentProblem:
    return EnvironmentProblem(
        f"Could not download {package}: {why.rstrip('.')}. Check the network (proxy, firewall), or put the package "
        f"file into a folder and name that folder in {OFFLINE_VARIABLE}, then run: python -m engine models fetch"
    )


def _opened(url: str, settings: NpmSettings, accept: str) -> http.client.HTTPResponse:
    headers = {"User-Agent": "gaussian-heritage", "Accept": accept, "Accept-Encoding": "identity"}
    return open_https(url, headers, secrets=settings.secrets_for(url), connection=settings.connection)


def _dist(text: bytes, url: str, version: str) -> dict[str, Any]:
    source = f"The answer of {url}"
    try:
        versions = parse_json(text.decode("utf-8"), _SCHEMA, source=source, advice=_ADVICE)["versions"]
    except UnicodeDecodeError as error:
        raise FormatError(f"{source} is no text. {_ADVICE}") from error
    if version not in versions:
        raise EnvironmentProblem(f"{url} has no version {version}. {_ADVICE}")
    problem = check(versions[version], _DIST)
    if problem:
        raise FormatError(f"{source} cannot be read: {problem}. {_ADVICE}")
    dist: dict[str, Any] = versions[version]["dist"]
    return dist


def _store(answer: IO[bytes], file: Path, dist: dict[str, Any], max_bytes: int, should_stop: StopCheck) -> None:
    """Write the body of an answer to `file`, which appears only with the hash that `dist` states."""
    method, wanted = _expected(dist)
    digest, size = hashlib.new(method, usedforsecurity=False), 0
    with atomic_write(file) as target:
        while chunk := answer.read(_CHUNK):
            digest.update(chunk)
            size += len(chunk)
            if size > max_bytes:
                raise ModelFileError(f"{file.name} has more than {max_bytes / 1e6:.0f} MB, and the package has less.")
            if should_stop():
                raise Cancelled("Stopped while fetching model files; the files fetched before are kept.")
            target.write(chunk)
        if digest.digest() != wanted:
            raise ModelFileError(f"{file.name} arrived damaged: its {method} is another one. Fetch it again.")


def _expected(dist: dict[str, Any]) -> tuple[str, bytes]:
    """Return the strongest hash that a registry states: its method and its value."""
    stated = dict(entry.split("-", 1) for entry in (dist.get("integrity") or "").split() if "-" in entry)
    try:
        for method in _STRONG:
            if method in stated:
                return _sized(method, base64.b64decode(stated[method].partition("?")[0], validate=True))
        return _sized("sha1", bytes.fromhex(dist.get("shasum") or ""))
    except ValueError as error:
        raise FormatError(f"The registry states a hash that is none ({error}). {_ADVICE}") from error


def _sized(method: str, digest: bytes) -> tuple[str, bytes]:
    if len(digest) != hashlib.new(method, usedforsecurity=False).digest_size:
        raise ValueError(f"{len(digest)} bytes for {method}")
    return method, digest
