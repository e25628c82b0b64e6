"""The computer that packages are downloaded for: pip's arguments, and the locked packages that it needs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import EnvironmentProblem
from ...core.files import read_text
from ...core.system import System

_ENTRY = re.compile(r"^(?=[A-Za-z0-9])", re.MULTILINE)
_HEAD = re.compile(r"([\w.-]+==[^\s;\\]+)\s*(?:;\s*([^\\\n]+?))?\s*(\\?\n.*)", re.DOTALL)
_MAX_BYTES = 4 << 20


@dataclass(frozen=True)
class Target:
    """A kind of computer with a version of Python.

    Attributes
    ----------
    system : System
    version : str
        For example "3.11".
    """

    system: System
    version: str

    @property
    def arguments(self) -> list[object]:
        """pip's arguments with which it takes files for this computer, whatever it runs on itself."""
        tags = [word for tag in self.system.tags for word in ("--platform", tag)]
        return [
            *tags,
            "--python-version",
            self.version,
            "--implementation",
            "cp",
            "--no-deps",
            "--only-binary",
            ":all:",
        ]

    def requirements(self, file: Path) -> str:
        """Return the text of a locked file with the packages that this computer needs, and without conditions.

        Raises
        ------
        EnvironmentProblem
            When the package `packaging` is missing in this Python.
        """
        try:
            from packaging.markers import Marker
        except ModuleNotFoundError as error:
            raise EnvironmentProblem(
                "Making an offline bundle needs the package `packaging`. Run it in the engine's environment, as "
                "`make offline-bundle` does."
            ) from error
        environment = {
            **self.system.markers, "python_version": self.version, "python_full_version": f"{self.version}.9",
            "implementation_name": "cpython", "platform_python_implementation": "CPython",
        }  # fmt: skip
        text = read_text(file, advice="Check out the repository again.", max_bytes=_MAX_BYTES)
        kept = []
        # A checkout on Windows may have its line ends.
        for entry in _ENTRY.split(text.replace("\r\n", "\n")):
            head = _HEAD.match(entry)
            if head and (head[2] is None or Marker(head[2]).evaluate(environment)):
                kept.append(f"{head[1]} {head[3].lstrip()}")
        return "".join(kept)
