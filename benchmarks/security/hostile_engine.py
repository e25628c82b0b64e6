"""Puts hostile projects through the commands of the engine in this process, under an audit hook."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import sys
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from engine.cli.main import main as engine
from engine.objects.settings import DEFAULT_PRESET, PRESETS

from .hostile_audit import watch
from .hostile_cases import CASES, HONEST, Case, Sandbox
from .hostile_packages import PACKAGES, package_of
from .kills_engine import shorten_stages
from .tree import changed_bytes, differences, snapshot

ALL_CASES = (*CASES, *PACKAGES)

ALLOWED = "GAUSSIAN_HERITAGE_HOSTILE_ALLOWED"
"""Environment variable: the user's folders of temporary files, compiled kernels and models, which may be written."""
COMMANDS = (
    "segment --complement",
    "segment --accept",
    "segment --refine --level",
    "segment --refine --click",
    "segment --click",
    "edit --merge --rename",
    "edit --level",
    "edit --delete",
    "measure",
    "vocabulary learn",
    "export, PLY",
    "export, GLB",
    "package",
    "render",
    "report",
    "trash list",
    "trash restore",
    "trash empty",
    "reconstruct",
)


@dataclass
class Outcome:
    """What one command did to one hostile project.

    Attributes
    ----------
    case, command : str
    code : int
        Exit code.
    sentence : str
        The error that the user saw; empty when the command succeeded.
    changed : list of str
        What was made, deleted or changed outside of the project, from the tree.
    audited : list of str
        What Python wrote, moved or deleted there, or tried to.
    n_bytes : int
        Bytes of the files that were changed.
    seconds : float
    """

    case: str
    command: str
    code: int
    sentence: str = ""
    changed: list[str] = field(default_factory=list)
    audited: list[str] = field(default_factory=list)
    n_bytes: int = 0
    seconds: float = 0.0

    @property
    def is_traceback(self) -> bool:
        """Whether the user saw an error that is not ours."""
        return "unexpected error" in self.sentence or "Traceback" in self.sentence


def arguments(command: str, case: Case, sandbox: Sandbox) -> list[str]:
    """Return the command line of one of `COMMANDS`, or of a further command of the case."""
    project, out = str(sandbox.project), sandbox.exports
    click = f"{case.photo}=106,128"
    reconstruct = ["reconstruct", str(sandbox.photos), "--out", project, "--preset", "test"]
    reconstruct += ["--cameras", str(sandbox.root / "sent" / "transforms.json")]
    lines = {
        "segment --complement": ["segment", project, "--complement"],
        "segment --accept": ["segment", project, "--accept", "1"],
        "segment --refine --level": ["segment", project, "--refine", "box", "--level", "0"],
        "segment --refine --click": ["segment", project, "--refine", "box", "--click", click],
        "segment --click": ["segment", project, "--click", click, "--name", "../../precious/x"],
        "edit --merge --rename": ["edit", project, "--merge", "teapot=box", "--rename", "teapot=../../precious/notes"],
        "edit --level": ["edit", project, "--level", "box=0", "--threshold", "box=0.4"],
        "edit --delete": ["edit", project, "--delete", "box"],
        "measure": ["measure", project, "--distance", "xyz=0,0,0", click, "0.4"],
        "vocabulary learn": ["vocabulary", "learn", project],
        "ask": ["ask", project, "--prompt", "jug", "--out", str(out / "answers")],
        "export, PLY": ["export", project, "--format", "ply", "--object", "box", "--out", str(out / "a.ply")],
        "export, GLB": ["export", project, "--format", "glb", "--out", str(out / "a.glb")],
        "package": ["package", project, "--object", "box", "--with-photos", "--out", str(out / "packages")],
        "verify": ["verify", str(package_of(sandbox))],
        "render": ["render", project, "--view", case.photo, "--object", "box", "--out", str(out / "a.png")],
        "report": ["report", project],
        "trash list": ["trash", "list", project],
        "trash restore": ["trash", "restore", project, "1"],
        "trash empty": ["trash", "empty", project],
        "reconstruct": [*reconstruct, "--no-objects"],
        "reconstruct-with-prompts": [*reconstruct, "--prompts", "jug"],
    }
    if command.startswith("export-object "):
        name = command.partition(" ")[2]
        return ["export", project, "--format", "ply", "--object", name, "--out", str(out / "b.ply")]
    return lines[command]


def run_case(case: Case, commands: tuple[str, ...], sandbox: Sandbox, audited: list[str]) -> list[Outcome]:
    """Put one hostile project through `commands`, each on a fresh copy.

    Parameters
    ----------
    case : Case
    commands : tuple of str
    sandbox : Sandbox
        Made anew for each command.
    audited : list of str
        What the audit hook of this process finds; it is emptied before each command.
    """
    outcomes = []
    for command in commands:
        sandbox.make(case)
        left_out = [sandbox.project, sandbox.exports, sandbox.user]
        before = snapshot(sandbox.root, without=left_out)
        audited.clear()
        begin = time.monotonic()
        code, sentence = _call(arguments(command, case, sandbox))
        seconds = time.monotonic() - begin
        found = list(dict.fromkeys(audited))
        after = snapshot(sandbox.root, without=left_out)
        outcome = Outcome(case.name, command, code, sentence, differences(before, after), found, seconds=seconds)
        outcome.n_bytes = changed_bytes(before, after)
        outcomes.append(outcome)
    return outcomes


def _call(line: list[str]) -> tuple[int, str]:
    """Run one command in this process and return its exit code and the sentence of its error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = engine([*line, "--events"])
        except SystemExit as error:  # the arguments were not understood
            return int(error.code or 0), err.getvalue().strip().splitlines()[-1]
        except Exception as error:  # noqa: BLE001 the command line must not let one pass
            return 1, f"Traceback: {type(error).__name__}: {error}"
    errors = [event for event in map(json.loads, out.getvalue().splitlines()) if event["kind"] == "error"]
    return code, errors[-1]["message"] if errors else ""


def main() -> int:
    """Run cases and print their outcomes as JSON lines.

    Arguments: folder of the sandbox; folder of the embeddings; numbers of the cases, none to make the embeddings.
    """
    root, embeddings, *numbers = sys.argv[1:]
    audited: list[str] = []
    shorten_stages()
    few = {"detail_steps": 5, "n_text_views": 1, "n_crop_views": 1}
    PRESETS[DEFAULT_PRESET] = replace(PRESETS[DEFAULT_PRESET], **few)  # type: ignore[arg-type]
    if not numbers:
        sandbox = Sandbox(Path(root))
        run_case(HONEST, ("segment --accept", "segment --click"), sandbox, audited)
        for file in (sandbox.project / "masks").glob("*.sam.npz"):
            shutil.copy(file, embeddings)
        return 0
    sandbox = Sandbox(Path(root), Path(embeddings))
    caches = [Path(folder) for folder in os.environ[ALLOWED].split(os.pathsep)]
    watch(lambda: (*sandbox.writable, *caches), audited.append)
    for case in (ALL_CASES[int(number)] for number in numbers):
        commands = ("verify",) if case.is_package else (*COMMANDS, *case.commands)
        for outcome in run_case(case, commands, sandbox, audited):
            print(json.dumps(asdict(outcome)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
