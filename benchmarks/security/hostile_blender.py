"""Opens hostile projects and hostile .blend files in Blender (bpy) with the installed extension, under an audit hook.

`benchmarks.security.hostile` runs this file with Blender's Python as a script and not as a module of the repository,
because the installed extension is what is tested. Its only argument is a JSON text with the fields of `Work`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

_WORK = json.loads(sys.argv[1])
# Blender reads its user folder when bpy is imported.
os.environ["BLENDER_USER_RESOURCES"] = _WORK["resources"]

import bpy  # noqa: E402
from hostile_audit import watch  # noqa: E402
from hostile_blends import BLENDS, splat_objects  # noqa: E402
from tree import changed_bytes, differences, snapshot  # noqa: E402

MODULE = "bl_ext.user_default.gaussian_heritage"


@dataclass(frozen=True)
class Work:
    """What is to be done.

    Attributes
    ----------
    resources : str
        Blender's user folder.
    zip, python : str
        The extension; the engine's Python, which records what it writes to the file `engine_found`.
    projects : list of (str, str, str)
        Name, sandbox and photo of each hostile project.
    blends : list of str
        A sandbox with an honest project for each of `BLENDS`.
    """

    resources: str
    zip: str
    python: str
    engine_found: str
    projects: list[tuple[str, str, str]]
    blends: list[str]


def _steps(sandbox: Path, photo: str, *, with_engine: bool) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what a curator does with an open scene, by name."""
    heritage = bpy.ops.heritage

    def type_title() -> None:
        for obj in splat_objects(bpy):
            obj.heritage.title = "mine"
            if obj.heritage.problem:
                raise RuntimeError(obj.heritage.problem)

    def move_sliders() -> None:
        for obj in splat_objects(bpy):
            obj.heritage.threshold, obj.heritage.part_to_whole = 0.7, 0.0
            if obj.heritage.problem:
                raise RuntimeError(obj.heritage.problem)

    exports = str(sandbox / "exports")
    yield "type a title", type_title
    yield "move the sliders", move_sliders
    yield "Look Through Photo", lambda: heritage.look_through_photo(photo=photo)
    yield "Export, PLY", lambda: heritage.export_objects(directory=exports, format="PLY", scope="ALL")
    yield "Export, glTF", lambda: heritage.export_objects(directory=exports, format="GLB", scope="ALL")
    if with_engine:
        yield "Background", lambda: heritage.isolate_background()
        yield "Isolate Candidate", lambda: heritage.accept_candidate(number=1)
    yield "Close List", lambda: heritage.dismiss_candidates()


class Runner:
    """Does one step after the other and prints what each changed outside of the project."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._sandbox = Path(work.resources)
        self._audited: list[str] = []
        watch(self._allowed, self._audited.append)

    def _writable(self) -> list[Path]:
        return [self._sandbox / "sent" / "project", self._sandbox / "exports", self._sandbox / "user"]

    def _allowed(self) -> list[Path]:
        return [Path(self._work.resources), *(folder.resolve() for folder in self._writable())]

    def enter(self, sandbox: Path) -> None:
        """Start with an empty scene and the folder of a case."""
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
        self._sandbox = sandbox
        os.environ["HERITAGE_HOSTILE_ALLOWED"] = os.pathsep.join(str(path.resolve()) for path in self._writable())

    def do(self, case: str, name: str, step: Callable[[], object]) -> None:
        """Do a step and print its outcome as a JSON line."""
        engine_found = Path(self._work.engine_found)
        engine_found.unlink(missing_ok=True)
        left_out = self._writable()
        before = snapshot(self._sandbox, without=left_out)
        self._audited.clear()
        sentence = ""
        try:
            step()
        except Exception as error:  # noqa: BLE001 an operator reports its error as RuntimeError
            sentence = f"{error}" if isinstance(error, RuntimeError) else f"Traceback: {type(error).__name__}: {error}"
        found = [*self._audited]
        if engine_found.is_file():
            found += engine_found.read_text(encoding="utf-8").splitlines()
        after = snapshot(self._sandbox, without=left_out)
        outcome = {
            "case": case,
            "command": f"Blender: {name}",
            "code": int(bool(sentence)),
            "sentence": sentence.strip(),
            "changed": differences(before, after),
            "audited": list(dict.fromkeys(found)),
            "n_bytes": changed_bytes(before, after),
        }
        print("OUTCOME " + json.dumps(outcome), flush=True)


def main() -> None:
    """Install the extension, then open every hostile project and every hostile .blend file."""
    work = Work(**_WORK)
    bpy.ops.extensions.package_install_files(filepath=work.zip, repo="user_default", enable_on_install=True)
    bpy.context.preferences.addons[MODULE].preferences.engine_python = work.python
    # Kept for the empty files that follow.
    bpy.ops.wm.save_userpref()
    runner = Runner(work)
    for case, folder, photo in work.projects:
        sandbox = Path(folder)
        runner.enter(sandbox)
        project = str(sandbox / "sent" / "project")
        runner.do(case, "Open Project", lambda: bpy.ops.heritage.open_project(directory=project))  # noqa: B023
        for name, step in _steps(sandbox, photo, with_engine=False):
            runner.do(case, name, step)
    for (case, change), folder in zip(BLENDS, work.blends, strict=True):
        sandbox = Path(folder)
        runner.enter(sandbox)
        bpy.ops.heritage.open_project(directory=str(sandbox / "sent" / "project"))
        change(bpy, sandbox / "precious")
        file = str(sandbox / "sent" / "hostile.blend")
        bpy.ops.wm.save_as_mainfile(filepath=file)
        runner.enter(sandbox)
        runner.do(case, "open the file", lambda: bpy.ops.wm.open_mainfile(filepath=file))  # noqa: B023
        for name, step in _steps(sandbox, "", with_engine=True):
            runner.do(case, name, step)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # bpy may wait for its own threads without end when Python ends.
    os._exit(0)
