"""The part of a weight file that was received before a download stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.errors import FormatError
from ...core.files import delete_derived, file_sha256, read_json, write_json
from .catalogue import ModelFile


@dataclass(frozen=True)
class PartialFile:
    """``<file>.part`` in the folder of the weight files, and its record ``<file>.part.json``.

    The part of a file whose SHA-256 is in the catalogue is resumed and checked as a whole at the end. The part of
    another file is resumed only if it still has the size and SHA-256 that were recorded when the download stopped, and
    if the server confirms by the ETag (a server's name for one version of a file) that it still has the same file.
    """

    folder: Path
    file: str

    @property
    def data(self) -> Path:
        """Path of the bytes received so far; it need not exist."""
        return self.folder / f"{self.file}.part"

    @property
    def _record(self) -> Path:
        return self.folder / f"{self.file}.part.json"

    def size(self) -> int:
        """Return the number of bytes received so far."""
        return self.data.stat().st_size if self.data.is_file() else 0

    def resume(self, model: ModelFile) -> tuple[int, str]:
        """Return the size and the ETag, empty if unknown, of a part that can be resumed; discard any other part."""
        size, etag = self.size(), ""
        try:
            if self._record.is_file():
                record = read_json(self._record, {"size": int, "sha256": str, "etag": str}, advice="")
                unchanged = record["size"] == size and file_sha256(self.data) == record["sha256"]
                # It is sent as a header, which can be nothing else.
                if unchanged and record["etag"].isascii() and record["etag"].isprintable():
                    etag = record["etag"]
        except FormatError:
            pass  # as without a record
        known = bool(etag) or model.sha256 is not None
        if not known or not 0 < size < model.size_limits[1]:
            self.discard()
            return 0, ""
        return size, etag

    def remember(self, etag: str) -> None:
        """Record the part and the ETag that the server sent with it."""
        if self.size():
            write_json(self._record, {"size": self.size(), "sha256": file_sha256(self.data), "etag": etag})

    def discard(self) -> None:
        """Delete the part and its record."""
        delete_derived(self.folder, self.data.name)
        delete_derived(self.folder, self._record.name)
