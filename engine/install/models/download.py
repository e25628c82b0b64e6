"""Download one weight file from its URL; an interrupted download is resumed."""

from __future__ import annotations

import http.client
import re
import time
import urllib.error
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import Cancelled, EnvironmentProblem, HeritageError, ModelFileError
from ...core.events import Emit, Progress, StopCheck
from ...core.files import file_sha256, opened, write_problem
from ...core.https import open_https
from ...core.system import replace_file
from .cache import OFFLINE_VARIABLE
from .catalogue import ModelFile
from .partial import PartialFile
from .verification import check_received, find_size_problem, refused

_CHUNK_BYTES = 1 << 18
_PROGRESS_INTERVAL_SECONDS = 0.5
_NETWORK_ERRORS = (OSError, http.client.HTTPException, ValueError)
_BY_HAND = "Get {file} from a colleague and run: python -m engine models fetch {name} --from FOLDER"


@dataclass(frozen=True)
class _Answer:
    """Facts about the body of a response from its headers: first byte in the file, size of the file, ETag."""

    start: int
    total: int
    etag: str


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
        When the URL does not exist, is not https or leads to an address that is not https; when the server offers or
        sends a web page or more than the catalogue allows; or when the received file differs from the catalogue or the
        record of the first use.
    EnvironmentProblem
        When the network cannot be reached or fails; the next call resumes the download.
    DiskError
        When `folder` cannot be written.
    FormatError
        When the record of the first use cannot be read.
    Cancelled
        When `should_stop` returns True; the next call resumes the download.
    """
    path = folder / model.file
    part = PartialFile(folder, model.file)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _receive(model, part, emit, should_stop)
        size, sha256 = part.size(), file_sha256(part.data)
        with opened(part.data, advice="Run the same command again.") as content:
            check_received(model, path, size, sha256, content=content, origin=model.source)
        replace_file(part.data, path)
    except ModelFileError:
        part.discard()
        raise
    except OSError as error:
        raise write_problem(part.data, error) from error
    part.discard()


def _receive(model: ModelFile, part: PartialFile, emit: Emit, should_stop: StopCheck) -> None:
    """Append the missing bytes to `part`."""
    start, etag = part.resume(model)
    try:
        response = _open(model, start, etag)
    except urllib.error.HTTPError as error:
        if error.code != http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE or not start:
            raise _server_problem(model, error) from error
        # The part is at least as long as the file on the server, so it belongs to another file.
        error.close()
        part.discard()
        start, etag = 0, ""
        try:
            response = _open(model, 0, "")
        except urllib.error.HTTPError as again:
            raise _server_problem(model, again) from again
    with response:
        answer = _read_headers(model, response, start, etag)
        if answer.start == 0:
            part.discard()
        try:
            _append(model, part, response, answer, emit, should_stop)
        except ModelFileError:
            raise
        except HeritageError:
            part.remember(answer.etag)
            raise


def _open(model: ModelFile, start: int, etag: str) -> http.client.HTTPResponse:
    """Ask the server for the bytes of `model` from `start` on; its refusals are raised as `HTTPError`."""
    headers = {"User-Agent": "gaussian-heritage", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if etag:
            headers["If-Range"] = etag
    try:
        return open_https(model.source, headers)
    except urllib.error.HTTPError:
        raise
    except _NETWORK_ERRORS as error:
        raise _network_problem(model, str(getattr(error, "reason", error)) or type(error).__name__) from error


def _read_headers(model: ModelFile, response: http.client.HTTPResponse, start: int, known_etag: str) -> _Answer:
    """Check the headers of a response before its body is read.

    Raises
    ------
    ModelFileError
        When the body is a web page, is neither the whole file nor its bytes from `start` on, belongs to another file
        than the part received so far, or the file has a size that the catalogue does not allow.
    """
    if response.headers.get_content_type() in ("text/html", "application/xhtml+xml"):
        raise refused(
            model,
            model.source,
            "is a web page",
            "Perhaps your network asks for a login: open any page in a browser, then run again: "
            f"python -m engine models fetch {model.name}",
        )
    etag = response.headers.get("ETag", "")
    if not etag.startswith('"'):  # a weak ETag (W/) does not guarantee equal bytes
        etag = ""
    span = re.fullmatch(r"bytes (\d{1,18})-\d{1,18}/(\d{1,18})", response.headers.get("Content-Range", ""))
    length = re.fullmatch(r"\d{1,18}", response.headers.get("Content-Length", ""))
    if response.status == http.HTTPStatus.PARTIAL_CONTENT and span and 0 < start == int(span[1]):
        if etag and known_etag and etag != known_etag:
            raise refused(model, model.source, "is not the file whose first part was received earlier")
        answer = _Answer(start, int(span[2]), etag or known_etag)
    elif response.status != http.HTTPStatus.OK:
        raise refused(model, model.source, f"is another part of the file than asked for (answer {response.status})")
    elif length or model.size is not None:
        answer = _Answer(0, int(length[0]) if length else model.size or 0, etag)
    else:
        # Without its size and its hash, a file that was cut off could not be noticed.
        raise refused(model, model.source, "comes without its size", _BY_HAND.format(file=model.file, name=model.name))
    problem = find_size_problem(model, answer.total)
    if problem is not None:
        raise refused(model, model.source, problem)
    return answer


def _append(
    model: ModelFile,
    part: PartialFile,
    response: http.client.HTTPResponse,
    answer: _Answer,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Write the body of the response to `part`, never more than the headers announced."""
    received, start_time, last_report = answer.start, time.perf_counter(), 0.0
    try:
        target = part.data.open("ab")
    except OSError as error:
        raise write_problem(part.data, error) from error
    with target:
        while True:
            try:
                chunk = response.read(_CHUNK_BYTES)
            except _NETWORK_ERRORS as error:
                raise _network_problem(model, str(error) or type(error).__name__) from error
            if not chunk:
                break
            received += len(chunk)
            if received > answer.total:
                raise refused(model, model.source, f"is longer than the {answer.total:,} bytes that were announced")
            try:
                target.write(chunk)
            except OSError as error:
                raise write_problem(part.data, error) from error
            if should_stop():
                raise Cancelled(
                    f"Stopped after {received / 1e6:.1f} MB of {model.name}; the next fetch continues there."
                )
            seconds = time.perf_counter() - start_time
            if seconds - last_report >= _PROGRESS_INTERVAL_SECONDS:
                last_report = seconds
                seconds_left = seconds / (received - answer.start) * (answer.total - received)
                message = f"{model.name}: {received / 1e6:.0f} of {answer.total / 1e6:.0f} MB"
                emit(Progress("models", received / answer.total, seconds_left, message=message))
    if received < answer.total:
        raise _network_problem(model, f"the connection broke after {received:,} of {answer.total:,} bytes")


def _server_problem(model: ModelFile, error: urllib.error.HTTPError) -> HeritageError:
    error.close()
    if error.code in (404, 410):
        by_hand = _BY_HAND.format(file=model.file, name=model.name)
        return ModelFileError(f"{model.name} is no longer at {model.source}. {by_hand}")
    return _network_problem(
        model, f"the server answered {error.code} {http.client.responses.get(error.code, '')}".strip()
    )


def _network_problem(model: ModelFile, reason: str) -> EnvironmentProblem:
    return EnvironmentProblem(
        f"Could not download {model.name} from {model.source}: {reason}. The part received so far is kept: run the "
        f"same command again to resume. Behind a proxy, set HTTPS_PROXY; without network, put {model.file} into a "
        f"folder and use --from FOLDER or {OFFLINE_VARIABLE}."
    )
