"""BagIt (RFC 8493): a folder ``data`` with the files, and lists of their SHA-256 beside it.

The library ``bagit`` writes the same, but it is offered only as source code that runs when it is installed, and the
engine installs nothing of that kind. The tests check that it accepts what is written here.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from ... import __version__
from ...core.files import file_sha256, write_file

PAYLOAD = "data"
_VERSION = "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"


def write_bag(folder: Path, info: Mapping[str, str]) -> None:
    """Make a bag of a folder whose files lie in its subfolder ``data``.

    Parameters
    ----------
    folder : Path
        Has nothing but ``data``.
    info : mapping of str to str
        More lines of ``bag-info.txt``, by label; line breaks in a value become spaces.

    Raises
    ------
    DiskError
        When a file cannot be written.
    """
    files = sorted(path for path in (folder / PAYLOAD).rglob("*") if path.is_file())
    sizes = [path.stat().st_size for path in files]
    lines = {
        "Bag-Software-Agent": f"Gaussian Heritage {__version__}",
        "Bagging-Date": datetime.now(UTC).date().isoformat(),
        "Payload-Oxum": f"{sum(sizes)}.{len(sizes)}",
        **info,
    }
    write_file(folder / "bagit.txt", _VERSION)
    text = "".join(f"{label}: {' '.join(value.split())}\n" for label, value in lines.items())
    write_file(folder / "bag-info.txt", text)
    write_file(folder / "manifest-sha256.txt", _manifest(folder, files))
    tags = [folder / name for name in ("bag-info.txt", "bagit.txt", "manifest-sha256.txt")]
    write_file(folder / "tagmanifest-sha256.txt", _manifest(folder, tags))


def _manifest(folder: Path, files: list[Path]) -> str:
    return "".join(f"{file_sha256(path)}  {escaped(path.relative_to(folder).as_posix())}\n" for path in files)


def escaped(name: str) -> str:
    """Return a path as manifests hold it: with line breaks and percent signs escaped."""
    return name.replace("%", "%25").replace("\n", "%0A").replace("\r", "%0D")
