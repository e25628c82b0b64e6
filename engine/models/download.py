"""Downloads one weight file from its address; what came before a break is kept and continued.

Proxies are those of the environment (``HTTPS_PROXY``, ``HTTP_PROXY``, ``NO_PROXY``), as everywhere in Python.
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
from ..project_folder import file_sha256
from .catalogue import OFFLINE_VARIABLE, ModelFile
from .packages import accept

__all__ = ["download"]

_CHUNK = 1 << 18
_TIMEOUT_SECONDS = 30.0
_TELL_SECONDS = 0.5


@dataclass(frozen=True)
class _Part:
    """What has come so far, and the server's mark (ETag) of the file it is a part of."""

    data: Path
    mark: Path

    def size(self) -> int:
        return self.data.stat().st_size if self.data.is_file() else 0

    def read_mark(self) -> str:
        return self.mark.read_text(encoding="ascii") if self.mark.is_file() else ""

    def discard(self) -> None:
        self.data.unlink(missing_ok=True)
        self.mark.unlink(missing_ok=True)


def download(model: ModelFile, folder: Path, *, emit: Emit, should_stop: StopCheck) -> None:
    """Put `model` into `folder` from its address; it appears there only when it is right.

    Parameters
    ----------
    model : ModelFile
        Its ``source`` is an address.
    folder : Path
        Made when missing. ``<file>.part`` in it is what came so far.
    emit : Emit
        Gets a `Progress` of stage ``models`` twice a second.
    should_stop : StopCheck
        Asked a few times a megabyte.

    Raises
    ------
    ModelFileError
        When the address holds nothing, or another file than the catalogue or the record of the first use says.
    EnvironmentProblem
        When the network cannot be reached or breaks; the next call continues.
    DiskError
        When `folder` cannot be written.
    Cancelled
        When `should_stop` says so; the next call continues.
    """
    path = folder / model.file
    part = _Part(path.with_name(path.name + ".part"), path.with_name(path.name + ".part.etag"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # A part can only be continued when it is known to be of the same file: by hash at the end, or by the mark.
        if part.size() and model.sha256 is None and not part.read_mark():
            part.discard()
        try:
            _receive(model, part, emit, should_stop)
        except urllib.error.HTTPError as error:
            if error.code != http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE or not part.size():
                raise
            # More than the file has: the part is of another one.
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
        accept(model, path, size, sha256)
    except ModelFileError:
        part.discard()
        raise
    os.replace(part.data, path)
    part.discard()


def _receive(model: ModelFile, part: _Part, emit: Emit, should_stop: StopCheck) -> None:
    """Append to `part` until the whole file is there."""
    start, mark = part.size(), part.read_mark()
    headers = {"User-Agent": "gaussian-heritage", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if mark:
            headers["If-Range"] = mark
    request = urllib.request.Request(model.source, headers=headers)
    # A fresh opener: the default one remembers the proxies of its first use.
    with urllib.request.build_opener().open(request, timeout=_TIMEOUT_SECONDS) as response:
        span = re.match(r"bytes (\d+)-\d+/(\d+)", response.headers.get("Content-Range", ""))
        if response.status == http.HTTPStatus.PARTIAL_CONTENT and span and int(span[1]) == start:
            total = int(span[2])
        else:
            start, total = 0, int(response.headers.get("Content-Length") or 0)
            part.discard()
            tag = response.headers.get("ETag", "")
            if tag.startswith('"'):  # a weak mark (W/) does not vouch for the bytes
                part.mark.write_text(tag, encoding="ascii")
        done, began, told = start, time.perf_counter(), 0.0
        with part.data.open("ab") as target:
            while chunk := response.read(_CHUNK):
                target.write(chunk)
                done += len(chunk)
                if should_stop():
                    raise Cancelled(
                        f"Stopped after {done / 1e6:.1f} MB of {model.name}; the next fetch continues there."
                    )
                seconds = time.perf_counter() - began
                if total and seconds - told >= _TELL_SECONDS:
                    told = seconds
                    left = seconds / (done - start) * (total - done)
                    message = f"{model.name}: {done / 1e6:.0f} of {total / 1e6:.0f} MB"
                    emit(Progress("models", min(1.0, done / total), left, message=message))
    if total and done < total:
        raise ConnectionError(f"the connection broke after {done:,} of {total:,} bytes")


def _network_problem(model: ModelFile, why: str) -> EnvironmentProblem:
    return EnvironmentProblem(
        f"Could not download {model.name} from {model.source}: {why}. What came is kept: run the same command again. "
        f"Behind a proxy set HTTPS_PROXY; without network put {model.file} into a folder and use --from FOLDER or "
        f"{OFFLINE_VARIABLE}."
    )
