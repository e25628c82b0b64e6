"""Download one weight file from its URL; an interrupted download is resumed.

Proxies are taken from the environment (``HTTPS_PROXY``, ``HTTP_PROXY``, ``NO_PROXY``), as usual in Python.
"""

from __future__ import annotations

import http.client
import os
import re
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path

from ..errors import Cancelled, DiskError, EnvironmentProblem, ModelFileError
from ..events import Emit, Progress, StopCheck
from ..files import file_sha256
from .cache import OFFLINE_VARIABLE
from .catalogue import ModelFile
from .verification import check_received

__all__ = ["download_file"]

_CHUNK_BYTES = 1 << 18
_TIMEOUT_SECONDS = 30.0
_PROGRESS_INTERVAL_SECONDS = 0.5


@dataclass(frozen=True)
class _PartialFile:
    """The bytes received so far, and the ETag of the file on the server that they belong to."""

    data: Path
    etag: Path

    def size(self) -> int:
        return self.data.stat().st_size if self.data.is_file() else 0

    def read_etag(self) -> str:
        return self.etag.read_text(encoding="ascii") if self.etag.is_file() else ""

    def discard(self) -> None:
        self.data.unlink(missing_ok=True)
        self.etag.unlink(missing_ok=True)


def download_file(model: ModelFile, folder: Path, *, emit: Emit, should_stop: StopCheck) -> None:
    """Download `model` from its URL into `folder`; it appears under its final name only after verification.

    Parameters
    ----------
    model : ModelFile
        Its ``source`` is a URL.
    folder : Path
        Created when missing. ``<file>.part`` in it contains the bytes received so far.
    emit : Emit
        Receives a `Progress` of stage ``models`` twice per second.
    should_stop : StopCheck
        Called about four times per megabyte.

    Raises
    ------
    ModelFileError
        When the URL does not exist, or the received file differs from the catalogue or the record of the first use.
    EnvironmentProblem
        When the network cannot be reached or fails; the next call resumes the download.
    DiskError
        When `folder` cannot be written.
    Cancelled
        When `should_stop` returns True; the next call resumes the download.
    """
    path = folder / model.file
    part = _PartialFile(path.with_name(path.name + ".part"), path.with_name(path.name + ".part.etag"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Resume only if the parts are known to be of the same file: by the hash at the end, or by the ETag.
        if part.size() and model.sha256 is None and not part.read_etag():
            part.discard()
        try:
            _receive(model, part, emit, should_stop)
        except urllib.error.HTTPError as error:
            if error.code != http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE or not part.size():
                raise
            # The partial file is at least as long as the file on the server, so it belongs to another file.
            part.discard()
            _receive(model, part, emit, should_stop)
    except urllib.error.HTTPError as error:
        if error.code in (404, 410):
            raise ModelFileError(
                f"{model.name} is no longer at {model.source}. Get {model.file} from a colleague and run: "
                f"python -m engine models fetch {model.name} --from FOLDER"
            ) from error
        raise _network_problem(model, f"the server answered {error.code} {error.reason}") from error
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        raise _network_problem(model, str(getattr(error, "reason", error)) or type(error).__name__) from error
    except OSError as error:
        raise DiskError(
            f"Could not write {part.data}: {error.strerror or error}. Free some space or choose another folder."
        ) from error
    size, sha256 = part.size(), file_sha256(part.data)
    try:
        check_received(model, path, size, sha256)
    except ModelFileError:
        part.discard()
        raise
    os.replace(part.data, path)
    part.discard()


def _receive(model: ModelFile, part: _PartialFile, emit: Emit, should_stop: StopCheck) -> None:
    """Append the missing bytes to `part`."""
    start, etag = part.size(), part.read_etag()
    headers = {"User-Agent": "gaussian-heritage", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if etag:
            headers["If-Range"] = etag
    request = urllib.request.Request(model.source, headers=headers)
    # A new opener: the default one keeps the proxies of its first use.
    with urllib.request.build_opener().open(request, timeout=_TIMEOUT_SECONDS) as response:
        span = re.match(r"bytes (\d+)-\d+/(\d+)", response.headers.get("Content-Range", ""))
        if response.status == http.HTTPStatus.PARTIAL_CONTENT and span and int(span[1]) == start:
            total = int(span[2])
        else:
            start, total = 0, int(response.headers.get("Content-Length") or 0)
            part.discard()
            new_etag = response.headers.get("ETag", "")
            if new_etag.startswith('"'):  # a weak ETag (W/) does not guarantee equal bytes
                part.etag.write_text(new_etag, encoding="ascii")
        received, start_time, last_report = start, time.perf_counter(), 0.0
        with part.data.open("ab") as target:
            while chunk := response.read(_CHUNK_BYTES):
                target.write(chunk)
                received += len(chunk)
                if should_stop():
                    raise Cancelled(
                        f"Stopped after {received / 1e6:.1f} MB of {model.name}; the next fetch continues there."
                    )
                seconds = time.perf_counter() - start_time
                if total and seconds - last_report >= _PROGRESS_INTERVAL_SECONDS:
                    last_report = seconds
                    seconds_left = seconds / (received - start) * (total - received)
                    message = f"{model.name}: {received / 1e6:.0f} of {total / 1e6:.0f} MB"
                    emit(Progress("models", min(1.0, received / total), seconds_left, message=message))
    if total and received < total:
        raise ConnectionError(f"the connection broke after {received:,} of {total:,} bytes")


def _network_problem(model: ModelFile, reason: str) -> EnvironmentProblem:
    return EnvironmentProblem(
        f"Could not download {model.name} from {model.source}: {reason}. The part received so far is kept: run the "
        f"same command again to resume. Behind a proxy, set HTTPS_PROXY; without network, put {model.file} into a "
        f"folder and use --from FOLDER or {OFFLINE_VARIABLE}."
    )
