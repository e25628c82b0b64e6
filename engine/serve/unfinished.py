"""Uploads that have begun: what was announced is kept in a file beside the bytes, so that they outlive the server.

The offset of an upload is the size of its file, which never holds a byte that does not belong there. What is announced
counts as used from the first moment, so that many uploads that begin together cannot pass a limit.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import re
import secrets
import shutil
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from ..core.errors import DiskError, HeritageError
from ..core.files import delete_derived, read_json, write_json, write_problem
from .settings import ServeSettings

_LOG = logging.getLogger(__name__)
_SCHEMA = {"project": str, "filename": str, "size": int, "sha256": str}
_ID = re.compile(r"[0-9a-f]{32}")
_DAY, _HOUR = 86400, 3600
_KEPT_RESULTS = 5000
"""Uploads that were taken in of which the server still knows, for clients that missed the last answer."""


class TooManyUploads(HeritageError):
    """A user has begun more uploads than are allowed."""


@dataclass(eq=False)
class Upload:
    """An upload of a user.

    Attributes
    ----------
    id, user, project, filename : str
        The project and the name are those that the client gave.
    size : int
        Bytes of the whole file.
    sha256 : str
        Of the whole file, where the client stated it; empty otherwise.
    file : Path
        The bytes that have arrived.
    taken : bool
        Whether it was complete and is in its project; its file is gone then.
    """

    id: str
    user: str
    project: str
    filename: str
    size: int
    sha256: str
    file: Path
    taken: bool = False
    began: float = field(default_factory=time.time)

    @property
    def offset(self) -> int:
        """Number of bytes that have arrived."""
        try:
            return self.size if self.taken else self.file.stat().st_size
        except FileNotFoundError:
            return 0

    def append(self, content: bytes | bytearray, offset: int) -> None:
        """Write `content` at `offset`, the present one; all of it or nothing.

        Raises
        ------
        DiskError
            When the disk is full.
        """
        try:
            with self.file.open("ab", buffering=0) as stream:
                try:
                    rest = memoryview(content)
                    while rest:
                        rest = rest[stream.write(rest) :]
                except OSError:
                    os.truncate(stream.fileno(), offset)
                    raise
        except OSError as error:
            raise _disk_problem(self.file, error) from error

    def cut(self, size: int) -> None:
        """Keep only the first `size` bytes.

        Raises
        ------
        DiskError
            When the file cannot be changed.
        """
        try:
            os.truncate(self.file, size)
        except OSError as error:
            raise _disk_problem(self.file, error) from error

    def force_to_disk(self) -> None:
        """Wait until the disk has all bytes, before the file is moved into a project."""
        try:
            with self.file.open("ab") as stream:
                os.fsync(stream.fileno())
        except OSError as error:
            raise _disk_problem(self.file, error) from error


class Uploads:
    """All uploads of a server."""

    def __init__(self, settings: ServeSettings) -> None:
        self._settings = settings
        self._beginning = threading.Lock()
        self._lock = threading.Lock()
        self._open: dict[str, Upload] = {}
        self._taken: OrderedDict[str, Upload] = OrderedDict()

    def load(self) -> None:
        """Find the uploads that an earlier server has left."""
        for info in self._settings.data.glob("users/*/uploads/*.json"):
            upload = _stored(info)
            if upload is not None:
                self._open[upload.id] = upload

    def begin(
        self,
        user: str,
        folder: Path,
        *,
        project: str,
        filename: str,
        size: int,
        sha256: str,
        used_bytes: Callable[[], int],
    ) -> Upload:
        """Begin an upload.

        Parameters
        ----------
        folder : Path
            Where the unfinished uploads of the user are.
        project, filename, size, sha256
            See `Upload`.
        used_bytes : callable
            Returns what the user has stored, unfinished uploads not included.

        Raises
        ------
        TooManyUploads
            When the user has too many unfinished ones.
        DiskError
            When the user's share, or the disk, is too small for everything that was announced.
        """
        upload_id = secrets.token_hex(16)
        with self._beginning:
            unfinished = self._unfinished()
            own = [one for one in unfinished if one.user == user]
            if len(own) >= self._settings.max_open_uploads:
                raise TooManyUploads(f"{len(own)} uploads have begun and not ended. End some of them first.")
            if used_bytes() + sum(one.size for one in own) + size > self._settings.max_user_bytes:
                share = self._settings.max_user_bytes / 1e9
                raise DiskError(
                    f"Your photos would take more than your {share:,.2g} GB, unfinished uploads and the trash included."
                    " Delete projects that are finished, and empty the trash."
                )
            missing = sum(one.size - one.offset for one in unfinished)
            folder.mkdir(parents=True, exist_ok=True)
            if _free_bytes(folder) - missing - size < self._settings.min_free_bytes:
                raise DiskError("The disk of the server is full. Ask its owner to make space, then upload again.")
            upload = Upload(upload_id, user, project, filename, size, sha256, folder / upload_id)
            with self._lock:
                self._open[upload_id] = upload
        try:
            upload.append(b"", 0)
            stored = {"project": project, "filename": filename, "size": size, "sha256": sha256}
            write_json(folder / f"{upload_id}.json", stored)
        except HeritageError:
            self.forget(upload)
            raise
        return upload

    def find(self, user: str, upload_id: str) -> Upload | None:
        """Return an upload of `user`; None where there is none of this id."""
        with self._lock:
            upload = self._open.get(upload_id) or self._taken.get(upload_id)
        return upload if upload is not None and upload.user == user else None

    def mark_taken(self, upload: Upload) -> None:
        """Note that an upload is in its project, for a client that asks again."""
        upload.taken = True
        with self._lock:
            self._taken[upload.id] = upload
            while len(self._taken) > _KEPT_RESULTS:
                self._taken.popitem(last=False)
        self.forget(upload)

    def forget(self, upload: Upload) -> None:
        """Delete an upload; what it announced is free again."""
        with self._lock:
            self._open.pop(upload.id, None)
        delete_derived(upload.file.parent, upload.file.name)
        delete_derived(upload.file.parent, f"{upload.file.name}.json")

    def abandoned(self) -> list[Upload]:
        """Return the uploads that were not continued for too long.

        One without a byte is given up after an hour: its client never learnt of it.
        """
        now = time.time()
        found = []
        for upload in self._unfinished():
            with contextlib.suppress(OSError):
                status = upload.file.stat()
                age = now - max(status.st_mtime, upload.began)
                if age > (self._settings.upload_days * _DAY if status.st_size else _HOUR):
                    found.append(upload)
        return found

    def _unfinished(self) -> list[Upload]:
        with self._lock:
            return list(self._open.values())

    def delete_strangers(self) -> None:
        """Delete old files beside the uploads that belong to none of them."""
        oldest = time.time() - self._settings.upload_days * _DAY
        for file in self._settings.data.glob("users/*/uploads/*"):
            with contextlib.suppress(OSError, HeritageError):
                if file.name.partition(".")[0] not in self._open and file.lstat().st_mtime < oldest:
                    delete_derived(file.parent, file.name)


def _stored(info: Path) -> Upload | None:
    """Return the upload that `info` describes; None where it is damaged."""
    if not _ID.fullmatch(info.stem) or not (file := info.with_suffix("")).is_file():
        return None
    try:
        known = read_json(info, _SCHEMA, advice="Delete it.")
    except HeritageError as error:
        _LOG.warning("%s", error)
        return None
    upload = Upload(info.stem, info.parent.parent.name, file=file, **{name: known[name] for name in _SCHEMA})
    upload.began = 0.0
    return upload if 0 <= upload.offset <= upload.size else None


def _free_bytes(folder: Path) -> int:
    return shutil.disk_usage(folder).free


def _disk_problem(file: Path, error: OSError) -> DiskError:
    if error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EFBIG):
        return DiskError("The disk of the server is full. Ask its owner to make space, then upload again.")
    return write_problem(file, error)
