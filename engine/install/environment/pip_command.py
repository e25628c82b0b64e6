"""Runs pip and other programs of an environment; their output goes to a log file."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.certificates import CERTIFICATE_VARIABLE
from ...core.errors import Cancelled, DiskError, EnvironmentProblem
from ...core.files import parse_json
from ...core.system import run_text
from ..programs import run_program

ONE_INDEX = {"PIP_EXTRA_INDEX_URL": " ", "PIP_FIND_LINKS": " "}
"""Environment variables with which pip asks only the index on its command line: they replace the user's other ones. An
empty value would not."""

_REPORT = {"install": [{"metadata": dict, "download_info": dict}]}
_UNTRUSTED = "SSLCertVerificationError"
"""In pip's output about a certificate. The words of the error are those of the system, in the user's language."""
_VERSION = re.compile(r"pip (\d+(?:\.\d+)*)")
_SERVER = re.compile(r"host='([\w.-]+)', port=(\d+)")
_STOPPED = "Stopped. What is installed is kept; set up again to continue."


class NotTrusted(EnvironmentProblem):
    """pip met a server whose certificate it does not trust.

    Attributes
    ----------
    host : str
        Empty when pip does not name it.
    port : int
    """

    def __init__(self, message: str, output: str) -> None:
        super().__init__(message)
        found = _SERVER.search(output)
        self.host, self.port = (found[1], int(found[2])) if found else ("", 443)


def run_logged(
    command: Sequence[object],
    log: Path,
    problem: str,
    *,
    on_line: Callable[[str], None] = lambda line: None,
    on_wait: Callable[[], None] = lambda: None,
    should_stop: Callable[[], bool] = lambda: False,
    variables: Mapping[str, str] | None = None,
) -> None:
    """Run `command` until it ends.

    Parameters
    ----------
    command : sequence
        Program and arguments.
    log : Path
        File that the output is appended to.
    problem : str
        Beginning of the sentence about a failure; the last line of the output that names an error follows.
    on_line : callable
        Called with each line of the output.
    on_wait : callable
        Called several times a second.
    should_stop : callable
        Asked several times a second; the program is ended when it returns true.
    variables : mapping, optional
        Added to the environment variables.

    Raises
    ------
    EnvironmentProblem
        When the program cannot be started or fails; `NotTrusted` when it refused a certificate.
    DiskError
        When the log cannot be written.
    Cancelled
        When `should_stop` returned true.
    """
    last = refused = ""
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        begin = log.stat().st_size if log.exists() else 0
        record = log.open("ab")
    except OSError as error:
        raise DiskError(
            f"{log} cannot be written: {error.strerror or error}. Check the disk and permissions."
        ) from error

    def follow() -> None:
        nonlocal begin, last, refused
        # Wine's C runtime reads nothing more behind an end of the file that it has seen.
        output.seek(begin)
        lines = output.readlines()
        begin = output.tell()
        for line in lines:
            on_line(line)
            if "ERROR" in line or "Error" in line or not last:
                last = line.strip()
            if _UNTRUSTED in line and not _SERVER.search(refused):
                refused = line
        on_wait()
        if should_stop():
            raise Cancelled(_STOPPED)

    with record, log.open("r", encoding="utf-8", errors="replace") as output:
        code = run_program(command, record, {**os.environ, **(variables or {})}, on_wait=follow)
    if code:
        message = f"{problem}: {last.rstrip('.')} (details: {log})."
        raise NotTrusted(message, refused) if refused else EnvironmentProblem(message)


def _variables(*, one_index: bool) -> dict[str, str]:
    """Return the environment variables with which pip reaches an index."""
    variables = dict(ONE_INDEX) if one_index else {}
    if (file := os.environ.get(CERTIFICATE_VARIABLE)) and "PIP_CERT" not in os.environ:
        # One variable for all that the engine fetches; pip has another name for it.
        variables["PIP_CERT"] = file
    return variables


class Pip:
    """pip of one Python.

    Parameters
    ----------
    python : Path
        The interpreter, usually that of a virtual environment.
    log : Path
        File that pip's output is appended to.
    wheels : Path, optional
        Folder with wheels that is used instead of any index.
    """

    def __init__(self, python: Path, log: Path, *, wheels: Path | None = None) -> None:
        self.python, self._log = python, log
        self._sources: list[object] = [] if wheels is None else ["--no-index", "--find-links", wheels]

    def install(
        self,
        arguments: Sequence[object],
        *,
        one_index: bool = False,
        on_line: Callable[[str], None] = lambda line: None,
        on_wait: Callable[[], None] = lambda: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run ``pip install`` with `arguments`; `one_index` asks only the index that they name.

        Raises
        ------
        EnvironmentProblem, DiskError, Cancelled
            As `run_logged`.
        """
        command = [self.python, "-m", "pip", "install", "--no-input", "--progress-bar", "off", *self._sources]
        run_logged(
            [*command, *arguments], self._log, "pip could not install the packages; check the network and the disk",
            on_line=on_line, on_wait=on_wait, should_stop=should_stop, variables=_variables(one_index=one_index),
        )  # fmt: skip

    def download(self, arguments: Sequence[object], folder: Path, *, one_index: bool = False) -> None:
        """Store the wheels that `install` would install in `folder`.

        Raises
        ------
        EnvironmentProblem, DiskError
            As `run_logged`.
        """
        command = [self.python, "-m", "pip", "download", "--no-input", "--progress-bar", "off", "--dest", folder]
        run_logged(
            [*command, *arguments], self._log, "pip could not download the packages; check the network and the disk",
            variables=_variables(one_index=one_index),
        )  # fmt: skip

    def version(self) -> tuple[int, ...]:
        """Return pip's version; empty when it cannot be started."""
        answer = run_text([self.python, "-m", "pip", "--version"])
        found = _VERSION.match(answer.stdout)
        return () if answer.returncode or not found else tuple(int(part) for part in found[1].split("."))

    def uninstall(self, package: str) -> None:
        """Remove `package`.

        Raises
        ------
        EnvironmentProblem, DiskError
            As `run_logged`.
        """
        problem = f"the other {package} could not be removed"
        run_logged([self.python, "-m", "pip", "uninstall", "--yes", package], self._log, problem)

    def offered(
        self, arguments: Sequence[object], *, one_index: bool = False, elsewhere: bool = False
    ) -> dict[str, Any] | None:
        """Return pip's report of the one package that it would install, None when it finds none within 20 s.

        With `elsewhere`, `arguments` name another kind of computer, for which pip only installs into a folder.

        Raises
        ------
        EnvironmentProblem
            `NotTrusted`, when pip refused the certificate of an index.
        """
        command: list[object] = [self.python, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet"]
        command += ["--report", "-", "--retries", "1", "--timeout", "20", *self._sources, *arguments]
        if elsewhere:
            command += ["--target", self._log.parent / "nowhere"]
        answer = run_text(command, environment={**os.environ, **_variables(one_index=one_index)})
        if _UNTRUSTED in answer.stderr:
            raise NotTrusted("pip refused the certificate of a server.", answer.stderr)
        if answer.returncode:
            return None
        report = parse_json(answer.stdout, _REPORT, source="pip's report", advice="Update pip.")
        return report["install"][0] if report["install"] else None
