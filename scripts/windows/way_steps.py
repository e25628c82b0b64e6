"""The way of a curator on Windows with the installed zip: set-up, reconstruction, objects, exports."""

from __future__ import annotations

import ast
import functools
import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from container_test import Failed, check_glb
from places import python_of

from .inputs import ALL_PHOTOS, PHOTOS, write_colmap_model, write_photos, write_transforms, write_video
from .launch import Windows
from .linux_only import IN_BLENDER
from .problem import Problem
from .steps import Context, Step
from .test_steps import test_addon

MAX_PATH = 260
WORD = "vase"
FORMATS = ("ply", "glb", "spz", "usd", "html")
CODE_PAGES = ("cp932", "cp1253", "cp1255")
PHOTO_FOLDER, VIDEO, FOLDER = "Pictures/Kość słoniowa, 3. Saal", "Videos/Rundgang Größe.mp4", "Documents/Projekte ÄÖÜ"
_BLENDER = "AppData/Roaming/Blender Foundation/Blender/4.5/extensions"
_EXTENSION, _USER_FOLDER = (
    f"{_BLENDER}/user_default/gaussian_heritage",
    f"{_BLENDER}/.user/user_default/gaussian_heritage",
)
_INSTALL_SECONDS, _JOB_SECONDS = 2400.0, 2400.0
_GRACE_SECONDS = 120.0
"""Of *Cancel*: long, because this computer may be busy; a job that heeds it ends much earlier."""
_STATE = "STATE "
_engines: dict[Path, tuple[Path, Path]] = {}
"""What `_places` answers, by computer."""
_SHOWN = 600


def way_steps() -> list[Step]:
    """Return the steps in their order."""
    network = "set up from the network"
    return [
        Step("zip", build_zip),
        *(Step(f"add-on in Blender: {name}", functools.partial(test_addon, name), ("zip",)) for name in IN_BLENDER),
        Step("bundle for Windows", write_bundle),
        Step(network, set_up_from_network, ("zip",)),
        Step("doctor and plan", doctor_and_plan, (network,)),
        Step("reconstruct photos, cancelled", reconstruct_and_cancel, (network,)),
        Step("continue", reconstruct_on, (network,)),
        Step("segment", segment, ("continue",)),
        *(Step(f"export {kind}", _export_step(kind), ("segment",)) for kind in FORMATS),
        Step("package and verify", package_and_verify, ("segment",)),
        Step("given cameras: COLMAP", reconstruct_with_colmap, (network,)),
        Step("given cameras: transforms.json", reconstruct_with_transforms, (network,)),
        Step("reconstruct a video", reconstruct_video, (network,)),
        *(Step(f"set up again with {page}", _code_page_step(page), (network,)) for page in CODE_PAGES),
        Step("set up without Visual C++", set_up_without_runtime, (network,)),
        Step("set up from the bundle, without a network", set_up_from_bundle, ("zip", "bundle for Windows")),
    ]


# ---- installing


def build_zip(context: Context) -> str:
    """Build the zip of the product, as `make zip` does."""
    out = context.zip_file
    environment = {**os.environ, "GAUSSIAN_HERITAGE_VENVS": str(python_of("engine").absolute().parents[2])}
    _on_linux([sys.executable, context.product / "scripts" / "build_extension.py", "--out", out], context, environment)
    return f"{out.stat().st_size / 1e6:.1f} MB"


def write_bundle(context: Context) -> str:
    """Write an offline bundle for Windows on this computer."""
    out = _bundle(context)
    out.unlink(missing_ok=True)
    _on_linux(
        [sys.executable, "-m", "engine.install.environment", "bundle", out, "--system", "windows"], context, os.environ
    )
    return f"{out.stat().st_size / 1e6:.0f} MB"


def set_up_from_network(context: Context) -> str:
    """Set the engine up with the settings of this computer's pip."""
    return _set_up(context, _curator(context))


def set_up_from_bundle(context: Context) -> str:
    """Set the engine up on a computer without a network."""
    computer = context.computer("offline", max_path=MAX_PATH, network=False)
    bundle = computer.home / "Downloads" / "Gaussian Heritage für Windows.zip"
    bundle.parent.mkdir(exist_ok=True)
    shutil.copy(_bundle(context), bundle)
    return _set_up(context, computer, ["--bundle", bundle])


def _export_step(kind: str) -> Any:
    return lambda context: export(context, kind)


def _code_page_step(page: str) -> Any:
    return lambda context: set_up_again(context, page)


def set_up_again(context: Context, code_page: str) -> str:
    """Set a complete engine up again on a computer with another code page: it is checked, and kept."""
    return _set_up(context, _curator(context, code_page=code_page), again=True)


def set_up_without_runtime(context: Context) -> str:
    """Set up where Microsoft's Visual C++ runtime is not installed: one sentence says so, and the engine is kept."""
    computer = context.computer("no-runtime", max_path=MAX_PATH)
    source = _curator(context)
    shutil.rmtree(computer.folder)
    subprocess.run(["cp", "-al", str(source.folder), str(computer.folder)], check=True)
    without = {"WINEDLLOVERRIDES": "msvcp140,msvcp140_1,msvcp140_2,concrt140,vcomp140="}
    state = _run_job(context, computer, "set-up", _install_command(computer, []), _INSTALL_SECONDS, without)
    if state["finished"] or "Visual C++" not in state["error"]:
        raise Problem(f"not a sentence with the name of what is missing: {state['error'] or 'it finished'}")
    if not _python(computer).exists():
        raise Problem("the engine that was there is gone")
    return str(state["error"])


def _curator(context: Context, **options: Any) -> Windows:
    return context.computer("curator", max_path=MAX_PATH, **options)


def _bundle(context: Context) -> Path:
    return context.cache / "offline_windows.zip"


def _places(computer: Windows) -> tuple[Path, Path]:
    """Return the folder that the product chooses for the engine on a computer, and the engine's Python in it."""
    if computer.folder not in _engines:
        program = (
            "from engine.install.environment import EngineEnvironment, default_folder\n"
            "engine = EngineEnvironment(default_folder())\n"
            "print(ascii([str(engine.folder), str(engine.python)]))"
        )
        root = computer.windows(computer.home / _EXTENSION)
        done = computer.run([computer.python, "-c", program], timeout=120, env={"PYTHONPATH": root})
        if done.code:
            raise Problem(f"the product does not tell its folder of the engine: {_end(done.err)}")
        folder, python = ast.literal_eval(done.out.strip())
        _engines[computer.folder] = computer.path(folder), computer.path(python)
    return _engines[computer.folder]


def _engine(computer: Windows) -> Path:
    return _places(computer)[0]


def _python(computer: Windows) -> Path:
    return _places(computer)[1]


def _set_up(context: Context, computer: Windows, options: Sequence[object] = (), *, again: bool = False) -> str:
    """Install the zip and the engine, as *Install from Disk* and *Set Up Engine* do."""
    if not again:
        extension = computer.home / _EXTENSION
        shutil.rmtree(extension, ignore_errors=True)
        with zipfile.ZipFile(context.zip_file) as archive:
            archive.extractall(extension)
    before = _python(computer).stat().st_mtime_ns if again else 0
    state = _run_job(context, computer, "set-up", _install_command(computer, options), _INSTALL_SECONDS)
    if not state["finished"]:
        raise Problem(f"{state['error_type']} {state['error']}{_tail(_engine(computer) / 'installation.log')}")
    if again and _python(computer).stat().st_mtime_ns != before:
        raise Problem("the environment was made anew")
    packages = len(list((_python(computer).parents[1] / "Lib" / "site-packages").glob("*.dist-info")))
    return f"the engine is ready, with {packages} packages"


def _install_command(computer: Windows, options: Sequence[object]) -> list[object]:
    """Return the command line of the installer, which Blender's Python runs."""
    words = [computer.python, "-m", "engine.install.environment", "install", "--folder", _engine(computer)]
    return [*words, "--torch", "cpu", "--python", computer.python, *options]


# ---- the engine


def doctor_and_plan(context: Context) -> str:
    """Ask what this computer is, and what a reconstruction would cost."""
    computer = _curator(context)
    photos = computer.home / PHOTO_FOLDER
    write_photos(photos)
    for words in (["doctor"], ["plan", photos]):
        _job(context, computer, words, "finished")
    return f"both end without a fault, for {len(PHOTOS)} photos in {PHOTO_FOLDER}"


def reconstruct_and_cancel(context: Context) -> str:
    """Start with photos, a quarter of them without EXIF as messengers send them, and press Cancel in the training."""
    computer = _curator(context)
    photos = computer.home / PHOTO_FOLDER
    write_photos(photos)
    state = _job(context, computer, _reconstruct_photos(computer), "cancelled", cancel_at=("training", 0.4))
    return f"cancelled at {state['cancelled_at']:.0%} of the training: {state['error']}"


def reconstruct_on(context: Context) -> str:
    """Start the same again, to the report."""
    computer = _curator(context)
    state = _job(context, computer, _reconstruct_photos(computer), "finished")
    _log(context, "continue", json.dumps(state, indent=1))
    events = (_jobs(computer) / "reconstruct" / "events.jsonl").read_text(encoding="utf-8")
    if "continued from a checkpoint" not in events:
        raise Problem("the training began anew")
    report = next((_project(computer)).rglob("*.html"), None)
    if report is None:
        raise Problem(f"{_project(computer)} has no report")
    return f"training from its checkpoint; {report.name} of {report.stat().st_size / 1e3:.0f} kB"


def segment(context: Context) -> str:
    """Isolate an object by a word."""
    computer = _curator(context)
    words = ["segment", _project(computer), "--prompt", WORD, "--device", "cpu"]
    state = _job(context, computer, words, "finished")
    return f"{WORD}: {json.dumps(state['outputs'])[:200]}"


def export(context: Context, kind: str) -> str:
    """Write the object as a file."""
    computer = _curator(context)
    out = computer.home / FOLDER / f"{WORD}, Größe.{kind}"
    out.unlink(missing_ok=True)
    words = ["export", _project(computer), "--object", WORD, "--format", kind, "--out", out]
    if kind == "usd":
        # An engine that Blender set up has no OpenUSD, so the add-on does not offer it; the command line says why.
        problem = str(_job(context, computer, words, "refused")["error"])
        if "usd-core" not in problem or out.exists():
            raise Problem(f"the missing OpenUSD is not told: {problem}")
        return f"refused: {problem}"
    _job(context, computer, words, "finished")
    if not out.is_file() or not out.stat().st_size:
        raise Problem(f"{out.name} was not written")
    if kind == "glb":
        try:
            return check_glb(out)
        except Failed as failure:
            raise Problem(str(failure)) from failure
    return f"{out.stat().st_size / 1e3:.0f} kB"


def package_and_verify(context: Context) -> str:
    """Write a package to keep, verify it, and find a change in it."""
    computer = _curator(context)
    packages = computer.home / FOLDER / "packages"
    shutil.rmtree(packages, ignore_errors=True)
    words = ["package", _project(computer), "--object", WORD, "--out", packages, "--device", "cpu"]
    _job(context, computer, words, "finished")
    (package,) = [entry for entry in packages.iterdir() if entry.is_dir()]
    _job(context, computer, ["verify", package], "finished")
    victim = next((package / "data").rglob("*.glb"))
    victim.write_bytes(victim.read_bytes()[:-1])
    state = _job(context, computer, ["verify", package], "refused")
    return f"{sum(1 for one in package.rglob('*') if one.is_file())} files; a shorter file is told: {state['error']}"


def reconstruct_with_colmap(context: Context) -> str:
    """Reconstruct with a COLMAP model, which is read in a child process."""
    computer = _curator(context)
    model = computer.home / "Documents" / "COLMAP Modell ä"
    write_colmap_model(model)
    return _given(context, computer, model, "colmap")


def reconstruct_with_transforms(context: Context) -> str:
    """Reconstruct with a transforms.json."""
    computer = _curator(context)
    file = computer.home / "Documents" / "transforms ł.json"
    write_transforms(file)
    return _given(context, computer, file, "transforms")


def _given(context: Context, computer: Windows, cameras: Path, name: str) -> str:
    photos = computer.home / PHOTO_FOLDER
    write_photos(photos)
    words = _reconstruct(photos, computer.home / FOLDER / name, "test", "--no-objects", "--cameras", cameras)
    _job(context, computer, words, "finished")
    return f"{len(PHOTOS)} photos with {cameras.name}, to the report"


def reconstruct_video(context: Context) -> str:
    """Reconstruct a video."""
    computer = _curator(context)
    video = computer.home / VIDEO
    write_video(video)
    words = _reconstruct(video, computer.home / FOLDER / "video", "test", "--no-objects")
    state = _job(context, computer, words, "finished")
    return f"{len(ALL_PHOTOS)} views as a video, to the report ({len(state['warnings'])} warnings)"


# ---- parts


def _project(computer: Windows) -> Path:
    return computer.home / FOLDER / "Kość słoniowa"


def _reconstruct(source: Path, out: Path, preset: str, *options: object) -> list[object]:
    return ["reconstruct", source, "--out", out, "--preset", preset, "--device", "cpu", *options]


def _reconstruct_photos(computer: Windows) -> list[object]:
    return _reconstruct(computer.home / PHOTO_FOLDER, _project(computer), "preview")


def _jobs(computer: Windows) -> Path:
    return computer.home / _USER_FOLDER / "jobs"


def _job(
    context: Context, computer: Windows, words: Sequence[object], end: str, cancel_at: tuple[str, float] | None = None
) -> dict[str, Any]:
    """Run a command of the engine as Blender does, and return the state of the job.

    `end` is how it must end: "finished", "cancelled", or "refused" with one sentence.
    """
    name = str(words[0])
    command = [_python(computer), "-m", "engine", *words]
    state = _run_job(context, computer, name, command, _JOB_SECONDS, cancel_at=cancel_at)
    told = f"{state['error_type']} {state['error']}".strip()
    if end == "finished" and not state["finished"]:
        raise Problem(f"{name}: {told}")
    if end == "cancelled" and (state["cancelled_at"] is None or state["error_type"] != "Cancelled"):
        raise Problem(f"{name}: not ended tidily by Cancel: {told or 'it finished'}")
    if end == "refused" and (state["finished"] or not state["error_type"]):
        raise Problem(f"{name}: not refused by a sentence: {told or 'it finished'}")
    return state


def _run_job(
    context: Context, computer: Windows, name: str, command: Sequence[object], seconds: float,
    environment: Mapping[str, str] | None = None, cancel_at: tuple[str, float] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Run a command as a job of the add-on and return its state at the end; it must have shown no traceback."""
    folder = _jobs(computer) / name
    request = {
        "extension": computer.windows(computer.home / _EXTENSION), "folder": computer.windows(folder),
        "command": [computer.windows(word) if isinstance(word, Path) else str(word) for word in command],
        "kernels": computer.windows(computer.home / _USER_FOLDER / "numba"), "cancel_at": cancel_at,
        "grace": _GRACE_SECONDS,
    }  # fmt: skip
    file = computer.home / "request.json"
    file.write_text(json.dumps(request), encoding="utf-8")
    script = Path(__file__).with_name("engine_job.py")
    variables = {"PYTHONDONTWRITEBYTECODE": "1", **(environment or {})}
    # Blender's Python has NumPy.
    blender = computer.environment_python("blender")
    done = computer.run([blender, script, file], timeout=seconds, env=variables)
    errors = folder / "errors.txt"
    _log(context, f"job {name}", f"{done.out}\n{done.err}\n{_read(errors)}")
    found = [line.removeprefix(_STATE) for line in done.out.splitlines() if line.startswith(_STATE)]
    if done.timed_out:
        raise Problem(f"{name}: no end within {seconds:.0f} s{_tail(errors)}")
    if done.code or not found:
        raise Problem(f"{name}: starting, polling or cancelling failed in Blender's process: {_end(done.err)}")
    if "Traceback" in _read(errors):
        raise Problem(f"{name}: a traceback: {_end(_read(errors))}")
    state: dict[str, Any] = json.loads(found[0])
    return state


def _on_linux(words: Sequence[object], context: Context, environment: Any) -> None:
    """Run a program of the product on this computer."""
    command = [str(word) for word in words]
    done = subprocess.run(
        command, cwd=context.product, env=dict(environment), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Problem(f"{' '.join(command[1:4])}: {_end(done.stderr or done.stdout)}")


def _log(context: Context, name: str, text: str) -> None:
    file = context.cache / "logs" / f"{name}.txt"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")


def _read(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""


def _end(text: str) -> str:
    return " ".join(text.split())[-_SHOWN:]


def _tail(file: Path) -> str:
    return f" ({file.name}: {_end(_read(file))})" if file.exists() else ""
