"""The folder in which Windows' programs run: Debian with Wine 10, and the drive C: of a new Windows computer.

Debian 12 has Wine 8, which is too old for tokenizers and torch, so debootstrap makes a root of Debian 13.
"""

from __future__ import annotations

import fcntl
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .c_runtime import COMPILER, add_complex_functions
from .launch import CERTIFICATES, CODE_PAGES, TEMPLATE, USER, WINE, Windows, require
from .problem import Problem, run

RELEASE = "trixie"
_PACKAGES = ("wine64", "wine", "locales", "ca-certificates")
_MINGW = "gcc-mingw-w64-x86-64-posix"


@contextmanager
def alone(cache: Path) -> Iterator[None]:
    """Keep another run from making the same folder."""
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "making.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise Problem(f"Another run is making {cache}: wait for its end.") from error
        yield


def make_root(cache: Path, say: Callable[[str], None]) -> Path:
    """Make what is missing of the root, and return it."""
    require()
    root = cache / "root"
    if not (root / "usr/bin/apt-get").exists() or (root / "debootstrap").exists():
        say(f"Debian {RELEASE} into {root}")
        shutil.rmtree(root, ignore_errors=True)
        run("debootstrap", "--variant=minbase", RELEASE, root, *_mirror())
    _copy_certificates(root)
    missing = [name for name in _PACKAGES if not (root / "usr/share/doc" / name).exists()]
    if not (root / WINE.lstrip("/")).exists() or missing:
        say("Wine")
        inside = ["chroot", root, "env", "DEBIAN_FRONTEND=noninteractive"]
        run(*inside, "apt-get", "update", "-qq")
        run(*inside, "apt-get", "install", "-y", "-qq", "--no-install-recommends", *_PACKAGES)
        run(*inside, "apt-get", "clean")
    _add_locales(root)
    _name_user(root)
    if shutil.which(COMPILER) is None:
        say("the compiler for Windows")
        run("apt-get", "update", "-qq")
        run("apt-get", "install", "-y", "-qq", "--no-install-recommends", _MINGW)
    add_complex_functions(root)
    return root


def _copy_certificates(root: Path) -> None:
    """Let programs of the root trust the hosts that this computer trusts."""
    if CERTIFICATES.is_file():
        target = root / CERTIFICATES.relative_to("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.unlink(missing_ok=True)
        shutil.copy(CERTIFICATES, target)


def _mirror() -> list[str]:
    """Return the Debian mirror of this computer, for debootstrap; nothing where apt names none."""
    command = ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages", "Origin: Debian"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    found = [line for line in done.stdout.split() if "security" not in line]
    return found[:1]


def _add_locales(root: Path) -> None:
    """Add the locales by which Wine chooses its code page."""
    present = run("chroot", root, "locale", "-a").lower().split()
    for locale in CODE_PAGES.values():
        if locale.lower().replace("utf-8", "utf8") not in present:
            run("chroot", root, "localedef", "-i", locale.partition(".")[0], "-f", "UTF-8", locale)


def _name_user(root: Path) -> None:
    """Give the first user of the root the name that Wine takes for the Windows user."""
    file = root / "etc/passwd"
    lines = file.read_text(encoding="utf-8").splitlines()
    line = f"{USER}:x:0:0:user:/root:/bin/bash"
    if lines[0] != line:
        file.write_text("\n".join([line, *(one for one in lines if one != line)]) + "\n", encoding="utf-8")


def make_template(cache: Path, say: Callable[[str], None]) -> Windows:
    """Make drive C: and the registry of a new Windows computer where they are missing, and return it."""
    template = Windows(cache, TEMPLATE)
    if (template.folder / "system.reg").exists():
        return template
    say("the drive C: of a new Windows computer")
    shutil.rmtree(template.folder, ignore_errors=True)
    template.folder.mkdir(parents=True)
    # Without .NET and a browser, which it would ask for in a window.
    done = template.run(["wineboot", "-i"], cwd=Path("/"), timeout=600, env={"WINEDLLOVERRIDES": "mscoree,mshtml="})
    if done.code or not template.home.is_dir() or not (template.folder / "system.reg").exists():
        shutil.rmtree(template.folder, ignore_errors=True)
        raise Problem(f"Wine could not make {template.folder}: it ended with code {done.code}. {done.err[-1500:]}")
    return template
