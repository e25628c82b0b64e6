"""Folders of the user, places inside of environments, and paths that are too long for Windows."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePath

CODE_ROOT = Path(__file__).resolve().parents[3]
"""The folder that contains the package `engine`: a checkout, or the extension."""
_PROBE = ".heritage-"


def engine_folder() -> Path:
    """Return the folder for the engine's environment in the user's data, which no other computer gets.

    Notes
    -----
    On Windows its path is short: a package's files have paths of 185 characters below the environment, and Windows
    allows 259 in all.
    """
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "gheritage"
    if sys.platform == "darwin":
        return home / "Library" / "Application Support" / "gaussian-heritage" / "engine"
    return Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share") / "gaussian-heritage" / "engine"


def npm_settings_files(settings: Mapping[str, str]) -> tuple[Path, ...]:
    """Return the files with npm's settings, which need not exist: those of the computer, then those of the user.

    Parameters
    ----------
    settings : mapping
        Settings from environment variables, which may name other files (``globalconfig``, ``userconfig``).
    """
    if sys.platform == "win32":
        of_computer = [Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming") / "npm/etc/npmrc"]
    else:
        of_computer = [Path("/etc/npmrc"), Path("/usr/etc/npmrc"), Path("/usr/local/etc/npmrc")]
    if "globalconfig" in settings:
        of_computer = [Path(settings["globalconfig"])]
    return (*of_computer, Path(settings.get("userconfig") or Path.home() / ".npmrc"))


def python_in(environment: Path) -> Path:
    """Return the interpreter of a virtual environment."""
    return program_in(environment, "python")


def program_in(environment: Path, name: str) -> Path:
    """Return a program of a virtual environment."""
    if sys.platform == "win32":
        return environment / "Scripts" / f"{name}.exe"
    return environment / "bin" / name


def library_folder(environment: Path) -> Path:
    """Return the folder of a virtual environment below which its packages lie."""
    return environment / ("Lib" if sys.platform == "win32" else "lib")


def native_path(path: Path) -> Path:
    """Return a path to the same file for libraries that take names in the code page of Windows, such as COLMAP.

    Elsewhere, and where all its letters are in the code page, it is `path` itself. Otherwise each folder has a short
    name (``JOSUKA~1``) that the disk keeps beside the long one.

    Parameters
    ----------
    path : Path
        Need not exist; its folder must, and its own name must be of the code page then.

    Raises
    ------
    OSError
        When the disk keeps no short names.
    """
    if sys.platform == "win32" and not _in_code_page(path):
        existing = path if path.exists() else path.parent
        short = Path(_short_name(existing), *path.relative_to(existing).parts)
        if not _in_code_page(short):
            raise OSError(
                f"{path} has letters that this Windows does not have in its code page, and COLMAP cannot read such "
                "names. Choose a folder without them, for example C:\\heritage"
            )
        return short
    return path


def takes_path(folder: Path, longest: PurePath) -> bool:
    """Return whether a file can be made below `folder` with a path as long as that of `longest`.

    Windows allows 259 characters unless an administrator has lifted the limit, and some folders of networks fewer. It
    is tried with a file of that length, which is deleted again.

    Parameters
    ----------
    folder : Path
        Created when missing.
    longest : PurePath
        Relative.

    Raises
    ------
    OSError
        When nothing at all can be written to `folder`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    top = Path(tempfile.mkdtemp(prefix=_PROBE, dir=folder))
    probe = folder / _as_long_below(top.name, longest)
    try:
        probe.parent.mkdir(parents=True, exist_ok=True)
        probe.touch()
        return True
    except OSError:
        return False
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(top)


def _as_long_below(top: str, longest: PurePath) -> PurePath:
    """Return a path whose first folder is `top` and that is as long as `longest`."""
    length, name = len(str(longest)), longest.name
    filler = length - len(top) - len(name) - 2
    if filler < 1:
        return PurePath(top, "x" * max(1, length - len(top) - 1))
    # Names of folders have at most 255 bytes.
    folders = ["x" * 99] * (filler // 100) + ["x" * (filler % 100)] * bool(filler % 100)
    return PurePath(top, *folders, name)


if sys.platform == "win32":
    _MAX_LONG_PATH = 1 << 15

    def _in_code_page(path: Path) -> bool:
        try:
            str(path).encode("mbcs", "strict")
            return True
        except UnicodeEncodeError:
            return False

    def _short_name(path: Path) -> str:
        """Return the name of the file or folder `path` with short names of all folders; `path` itself without them."""
        text = ctypes.create_unicode_buffer(_MAX_LONG_PATH)
        length = ctypes.WinDLL("kernel32").GetShortPathNameW(str(path.absolute()), text, _MAX_LONG_PATH)
        return text.value if length else str(path)
