"""Run Windows' python.exe under Wine, as the user `USER` of a Windows computer.

    python scripts/windows/launch.py [options] -- python arguments

example: python scripts/windows/launch.py --packages -- -m pytest -q tests/engine/core/files
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from windows.problem import Problem

USER = "José Łukasz-Ångström Müller"
"""The user's name, with letters that no single code page has, spaces and 27 characters."""

FOLDER_VARIABLE = "GAUSSIAN_HERITAGE_WINDOWS"
CODE_PAGES = {
    "cp1252": "en_US.UTF-8", "cp932": "ja_JP.UTF-8", "cp1253": "el_GR.UTF-8", "cp1255": "he_IL.UTF-8",
    "cp1257": "lt_LT.UTF-8", "cp874": "th_TH.UTF-8", "cp936": "zh_CN.UTF-8", "cp949": "ko_KR.UTF-8",
    "cp1250": "pl_PL.UTF-8", "cp1251": "uk_UA.UTF-8",
}  # fmt: skip
"""ANSI code pages that Windows can have, and the locale by which Wine chooses each."""

CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")

TEMPLATE = "template"
"""Name of the prefix that all others are copied from."""

PYTHON_FOLDER, STAMP = "Program Files/Python311", "made-from.txt"
"""Python on drive C:, and the file that says what it was made from."""

ENVIRONMENTS = ("tests", "blender")
"""Environments on drive C: with locked packages: of the engine with its tests, and of Blender 4.5 as a module."""

WINE = "/usr/lib/wine/wine64"
_NOT_SHARED = {
    *("bin", "boot", "dev", "etc", "lib", "lib32", "lib64", "libx32", "lost+found", "proc", "run", "sbin", "sys"),
    *("usr", "var"),
}
"""Folders of this computer that the root has itself. All others are seen there under the same path."""

_STOPPED = 124
"""Exit code of a run that was ended at its time limit, as that of `timeout`."""

_INSIDE = r"""
set -u
root=$1 home=$2; shift 2
mount --make-rprivate /
mount -t proc proc "$root/proc"
for folder in dev sys "$@"; do
    [ "$folder" = -- ] && break
    mkdir -p "$root/$folder"; mount --bind "/$folder" "$root/$folder"
done
while [ "$1" != -- ]; do shift; done; shift
exec chroot "$root" /usr/bin/env -i "$@"
"""
# The shell stays: as first process of the namespace it outlives Wine, so that Wine's server can write the registry.
_START = 'cd "$FOLDER_OF_WORK" && "$@"; code=$?; /usr/lib/wine/wineserver64 -k; exit $code'


def cache_folder() -> Path:
    """Return the folder with the root, Windows' Python and the wheels.

    It is ``$GAUSSIAN_HERITAGE_WINDOWS``, else ``.cache/windows`` in the repository.
    """
    configured = os.environ.get(FOLDER_VARIABLE)
    return Path(configured or Path(__file__).resolve().parents[2] / ".cache" / "windows").absolute()


@dataclass(frozen=True)
class Done:
    """How a run ended.

    Attributes
    ----------
    code : int
        Exit code of the Windows program; 124 after the time limit.
    out, err : str
        What it printed; "" when it was not captured.
    """

    code: int
    out: str = ""
    err: str = ""

    @property
    def timed_out(self) -> bool:
        """Whether the time limit ended it."""
        return self.code == _STOPPED


@dataclass(frozen=True)
class Windows:
    """A Windows computer: Wine's prefix with the drive C: of one user.

    Attributes
    ----------
    cache : Path
        As `cache_folder`.
    prefix : str
        Name of the prefix, copied from the template when it is used for the first time. One program runs in it at a
        time.
    code_page : str
        One of `CODE_PAGES`.
    max_path : int
        Longest path, with the zero at its end, that Python's functions accept; 0 for no limit. Windows without long
        paths has 260.
    network : bool
        Whether programs reach the network.
    environment : mapping
        More environment variables.
    """

    cache: Path = field(default_factory=cache_folder)
    prefix: str = "default"
    code_page: str = "cp1252"
    max_path: int = 0
    network: bool = True
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """The prefix."""
        return self.cache / "prefixes" / self.prefix

    @property
    def drive(self) -> Path:
        """Drive C:."""
        return self.folder / "drive_c"

    @property
    def python(self) -> Path:
        """Windows' Python, without packages."""
        return self.drive / PYTHON_FOLDER / "python.exe"

    @property
    def tests_python(self) -> Path:
        """Python of an environment with all locked packages, for tests of a checkout."""
        return self.environment_python("tests")

    def environment_python(self, name: str) -> Path:
        """Return Python of one of `ENVIRONMENTS`."""
        return self.drive / name / "Scripts" / "python.exe"

    @property
    def home(self) -> Path:
        """The user's folder."""
        return self.drive / "users" / USER

    def path(self, windows: str) -> Path:
        r"""Return where a path of Windows, such as ``C:\Users\x``, lies on this computer."""
        drive, _, rest = windows.replace("\\", "/").partition(":/")
        return (self.drive if drive.lower() == "c" else Path("/")) / rest

    def windows(self, path: Path) -> str:
        """Return the path that Windows' programs have for a file of this computer."""
        path = path.absolute()
        if path.is_relative_to(self.drive):
            return "C:\\" + str(path.relative_to(self.drive)).replace("/", "\\")
        return "Z:" + str(path).replace("/", "\\")

    def prepare(self) -> None:
        """Copy the template when the prefix is new. Files that Windows' programs do not change are shared with it."""
        if self.prefix == TEMPLATE:
            return
        template = self.cache / "prefixes" / TEMPLATE
        if not (template / "system.reg").exists():
            raise Problem(f"{self.cache} has no Wine prefix. Run: python scripts/windows_test.py --only root")
        if not (self.folder / "system.reg").exists():
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.parent.mkdir(exist_ok=True)
            # Hard links: Wine replaces the files of its registry and does not write into its libraries.
            subprocess.run(["cp", "-al", str(template), str(self.folder)], check=True)
        stamps = [drive / PYTHON_FOLDER / STAMP for drive in (template / "drive_c", self.drive)]
        if stamps[0].exists() and not (stamps[1].exists() and stamps[1].samefile(stamps[0])):
            # The template has got another Python.
            for name in (PYTHON_FOLDER, *ENVIRONMENTS):
                shutil.rmtree(self.drive / name, ignore_errors=True)
                subprocess.run(["cp", "-al", str(template / "drive_c" / name), str(self.drive / name)], check=True)

    def run(
        self, program: Sequence[object], *, cwd: Path | None = None, timeout: float | None = None, capture: bool = True,
        stdin: int = subprocess.DEVNULL, env: Mapping[str, str] | None = None, log: Path | None = None,
    ) -> Done:  # fmt: skip
        """Run a Windows program and everything that it starts until it ends.

        Parameters
        ----------
        program : sequence
            Program and arguments. A `Path` is passed as path of Windows.
        cwd : Path, optional
            Folder of work; the user's folder by default.
        timeout : float, optional
            Seconds after which all its processes are killed.
        capture : bool
            Whether its output is returned; else it goes to that of this process.
        stdin : int
            As for `subprocess.run`.
        env : mapping, optional
            More environment variables.
        log : Path, optional
            File that all its output is written to while it runs; `Done.out` is what it has at the end.

        Raises
        ------
        Problem
            When this computer cannot run it, or another program runs in the prefix.
        """
        with contextlib.ExitStack() as stack:
            stack.enter_context(self.locked())
            output = stack.enter_context(log.open("wb")).fileno() if log else subprocess.PIPE if capture else None
            process = stack.enter_context(self.start(program, cwd=cwd, output=output, stdin=stdin, env=env))
            code = None
            try:
                out, err = process.communicate(timeout=timeout)
            except subprocess.TimeoutExpired:
                code = _STOPPED
                process.kill()
                out, err = process.communicate()
            except BaseException:
                process.kill()
                raise
        if log:
            out = log.read_bytes()
        return Done(process.returncode if code is None else code, _text(out), _text(err))

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other programs from starting in the prefix."""
        self.prepare()
        with self.folder.with_suffix(".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise Problem(f"Another program runs in the prefix {self.prefix}: name another one.") from error
            yield

    def start(
        self, program: Sequence[object], *, cwd: Path | None = None, output: int | None = subprocess.PIPE,
        stdin: int = subprocess.DEVNULL, env: Mapping[str, str] | None = None,
    ) -> subprocess.Popen[bytes]:  # fmt: skip
        """Start a Windows program within `locked`; killing the returned process ends all that it has started."""
        require()
        root = self.cache / "root"
        words = [self.windows(word) if isinstance(word, Path) else str(word) for word in program]
        variables = {
            **self.variables(), **self.environment, **(env or {}), "FOLDER_OF_WORK": str((cwd or self.home).absolute())
        }  # fmt: skip
        shared = [f.name for f in sorted(Path("/").iterdir()) if f.is_dir() and f.name not in _NOT_SHARED]
        # Both ends: that of this process ends `unshare`, and that of `unshare` ends all that runs in its namespace.
        command = ["setpriv", "--pdeathsig", "KILL", "unshare", "--mount", "--pid", "--fork", "--kill-child"]
        command += [*([] if self.network else ["--net"]), "bash", "-c", _INSIDE, "_", str(root), USER]
        command += [*shared, "--", *(f"{name}={value}" for name, value in variables.items())]
        command += ["/bin/bash", "-c", _START, "_", WINE, *words]
        return subprocess.Popen(command, stdin=stdin, stdout=output, stderr=output)

    def variables(self) -> dict[str, str]:
        """Return the environment variables of all programs.

        KMP_AFFINITY: torch's OpenMP would ask for nodes of memory, which Wine does not know.
        """
        if self.code_page not in CODE_PAGES:
            raise Problem(f"{self.code_page} is none of the code pages {', '.join(CODE_PAGES)}.")
        locale = CODE_PAGES[self.code_page]
        return {
            "WINEPREFIX": str(self.folder), "WINEDEBUG": os.environ.get("WINEDEBUG", "-all"), "PATH": "/usr/bin:/bin",
            "HOME": "/root", "XDG_RUNTIME_DIR": "/tmp", "LANG": locale, "LC_ALL": locale, "KMP_AFFINITY": "disabled",
            "WINTEST_MAX_PATH": str(self.max_path), **network_variables(),
        }  # fmt: skip


def network_variables() -> dict[str, str]:
    """Return this computer's settings of pip, npm and the network that Windows' programs can use too."""
    kept = {
        name: value for name, value in os.environ.items()
        if name.lower() in ("http_proxy", "https_proxy", "no_proxy") or name == "PIP_DEFAULT_TIMEOUT"
    }  # fmt: skip
    answer = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True, check=False
    )
    settings: dict[str, str] = {}
    for line in answer.stdout.splitlines():
        name, _, value = line.partition("=")
        settings[name.rpartition(".")[2].strip()] = " ".join(value.strip("'").split("\\n"))
    if "index-url" in settings:
        kept["PIP_INDEX_URL"] = settings["index-url"]
    if others := [word for word in settings.get("extra-index-url", "").split() if not word.startswith("file:")]:
        kept["PIP_EXTRA_INDEX_URL"] = " ".join(others)
    if "trusted-host" in settings:
        kept["PIP_TRUSTED_HOST"] = settings["trusted-host"]
    if CERTIFICATES.is_file():
        # The root has a copy under the same path.
        kept["PIP_CERT"] = kept["SSL_CERT_FILE"] = "Z:" + str(CERTIFICATES).replace("/", "\\")
    kept["PIP_DISABLE_PIP_VERSION_CHECK"] = "1"
    return kept


def require() -> None:
    """Raise when this computer cannot run Windows' programs so."""
    missing = [name for name in ("setpriv", "unshare", "chroot", "debootstrap") if shutil.which(name) is None]
    if sys.platform != "linux" or os.geteuid() != 0 or missing:
        lacking = ", ".join(missing) or "debootstrap"
        raise Problem(f"Windows' Python is run under Wine, which needs Linux, root and {lacking} (docs/windows.md).")


def _text(content: bytes | None) -> str:
    return (content or b"").decode("utf-8", errors="replace").replace("\r\n", "\n")


def main() -> int:
    """Run one program and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prefix", default="default", help="Windows computer to use; made when new (%(default)s)")
    parser.add_argument("--packages", action="store_true", help="use the environment with all locked packages")
    parser.add_argument("--code-page", choices=CODE_PAGES, default="cp1252", help="(%(default)s)")
    parser.add_argument("--max-path", type=int, default=0, help="260 as on Windows; 0: no limit (%(default)s)")
    parser.add_argument("--timeout", type=float, help="seconds")
    parser.add_argument("--env", action="append", default=[], metavar="NAME=VALUE", help="may be repeated")
    parser.add_argument("arguments", nargs="*", help="of the program; those that are paths here begin with file:")
    options = parser.parse_args()
    environment = dict(line.split("=", 1) for line in options.env)
    windows = Windows(
        prefix=options.prefix, code_page=options.code_page, max_path=options.max_path, environment=environment
    )
    program = windows.tests_python if options.packages else windows.python
    words = [Path(word[5:]) if word.startswith("file:") else word for word in options.arguments]
    try:
        done = windows.run([program, *words], cwd=Path.cwd(), timeout=options.timeout, capture=False)
    except Problem as problem:
        print(f"Failed: {problem}", file=sys.stderr)
        return 1
    if done.timed_out:
        print(f"Stopped after {options.timeout:.0f} s.", file=sys.stderr)
    return done.code


if __name__ == "__main__":
    sys.exit(main())
