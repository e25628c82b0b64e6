"""How a Python is installed on this system."""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Sequence

from .text import run_text


def python_advice(versions: Sequence[tuple[int, int]]) -> str:
    """Return a sentence that says how one of `versions` of Python is installed here, the first being the best."""
    names = [f"{major}.{minor}" for major, minor in versions]
    if sys.platform in ("win32", "darwin"):
        kind = "Windows installer (64-bit)" if sys.platform == "win32" else "macOS 64-bit universal2 installer"
        return f"Install Python {names[0]} from python.org ({kind})."
    listed = f"{', '.join(names[:-1])} or {names[-1]}"
    if shutil.which("apt-get"):
        # Each release of Debian and Ubuntu has one or two versions, and python.org has none for Linux.
        for name in names:
            package = f"python{name}-venv"
            if shutil.which("apt-cache") and run_text(["apt-cache", "show", "--no-all-versions", package]).stdout:
                return f"Run in a terminal: sudo apt-get install {package}."
    elif shutil.which("dnf"):
        return f"Run in a terminal: sudo dnf install python{names[0]} (or another of {listed})."
    elif shutil.which("zypper"):
        return f"Run in a terminal: sudo zypper install python{names[0].replace('.', '')}."
    distribution = _distribution()
    return (
        f"Install Python {listed} from the packages of {distribution}; where they have none of these, install uv, "
        f"which brings its own Pythons, and run in a terminal: uv python install {names[0]}."
    )


def _distribution() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME") or "your system"
    except OSError:
        return "your system"
