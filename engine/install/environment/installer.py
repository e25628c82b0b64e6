"""Installs the engine's environment: finds a Python, creates the environment, installs packages, fetches the models.

Every step can be repeated: an installation that was stopped continues with what is there, and a damaged environment is
created anew.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TypeVar

from ...core.certificates import untrusted_certificate
from ...core.engine_process import engine_command, engine_environment
from ...core.errors import EnvironmentProblem
from ...core.events import Emit, ErrorEvent, Event, Finished, Progress, StageStarted, StopCheck, Warned, from_json_line
from ...core.files import delete_derived
from ...core.system import library_folder, missing_runtime, python_advice, run_text, takes_path, unsupported
from .bundle import Bundle
from .contents import DISK_GB
from .environment import FOLDER_VARIABLE, EngineEnvironment
from .locked import locked_arguments, locked_file, pinned, pins_in
from .pip_command import NotTrusted, Pip, run_logged
from .pip_wheel import fetch_pip
from .pythons import VERSIONS, Interpreter, find_pythons, usable, version_text
from .torch_builds import TorchSource, default_build, torch_source

Answer = TypeVar("Answer")

STAGE = "set-up"
_PIP_WITH_TRUSTSTORE = (24, 2)
"""From this version on, pip trusts what the operating system trusts."""
_SHARES = {"environment": 0.04, "packages": 0.50, "torch": 0.30, "models": 0.16}
"""Share of each step of the progress, by the time that it takes."""

LONGEST_PATH = PurePath(
    "Lib/site-packages/torch-2.13.0.dist-info/licenses/third_party/kineto/libkineto/third_party/dynolog/third_party/"
    "prometheus-cpp/3rdparty/civetweb/src/third_party/duktape-1.8.0/LICENSE.txt"
)
"""The longest path of a package's file in an environment on Windows, tried before anything is downloaded."""

_COLLECTING = re.compile(r"\s*Collecting ([\w.-]+)")
_DOWNLOADING = re.compile(r"\s*Downloading (\S+) (\([\d.]+ [kMG]B\))")
_IMPORTS = "import torch, pycolmap, onnxruntime, cv2, numba, scipy, sklearn, PIL, tokenizers, matplotlib"


@dataclass(frozen=True)
class _Run:
    """Values that all steps of one installation share."""

    environment: EngineEnvironment
    wheels: Path | None
    models: Path | None
    emit: Emit
    should_stop: StopCheck

    @property
    def pip(self) -> Pip:
        return Pip(self.environment.python, self.environment.log, wheels=self.wheels)

    def report(self, step: str, fraction: float, message: str) -> None:
        steps = list(_SHARES)
        before = sum(_SHARES[name] for name in steps[: steps.index(step)])
        self.emit(Progress(STAGE, before + _SHARES[step] * min(fraction, 1.0), message=message))


def install(
    environment: EngineEnvironment,
    *,
    pythons: Sequence[Path] = (),
    build: str = "auto",
    bundle: Path | None = None,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Install, repair or update `environment`.

    Parameters
    ----------
    pythons : sequence of Path
        Interpreters to try first, in this order. Others of this computer follow.
    build : {"auto", "cpu", "cuda"}
        Build of torch; "auto" as `default_build`.
    bundle : Path, optional
        Offline bundle to install from, without a network.
    emit : Emit
        Receives `Progress` of the stage ``set-up``, and `Finished`.

    Raises
    ------
    EnvironmentProblem
        When the packages do not exist for this computer, no Python fits, the disk has too little space, paths below the
        folder would be too long, or a package cannot be installed.
    FormatError
        When the bundle is not one, or is damaged.
    ProjectError
        When the folder has other content.
    DiskError
        When the folder cannot be written.
    Cancelled
        When `should_stop` returned true; what is installed is kept.
    """
    emit = _without_repeats(emit)
    emit(StageStarted(STAGE))
    if problem := unsupported() or missing_runtime():
        raise EnvironmentProblem(problem)
    packed = Bundle.read(bundle) if bundle is not None else None
    if packed is not None:
        packed.require_this_system()
    wanted = packed.torch if packed is not None else default_build() if build == "auto" else build
    is_new = not environment.root.exists()
    if is_new:
        _require_space(environment, wanted)
    environment.begin()
    if is_new:
        _require_short_path(environment)
    unpacked = environment.folder / "unpacked"
    try:
        wheels = models = None
        if packed is not None:
            packed.unpack(unpacked, emit)
            wheels, models = unpacked / "wheels", unpacked / "models"
        run = _Run(environment, wheels, models, emit, should_stop)
        try:
            version, source = _install_packages(run, pythons, wanted, packed)
        except _Damaged:
            if is_new:
                raise
            # What an earlier installation left.
            delete_derived(environment.folder, environment.root.name)
            version, source = _install_packages(run, pythons, wanted, packed)
        _fetch_models(run)
    finally:
        delete_derived(environment.folder, unpacked.name)
    environment.finish(version, source.build)
    emit(Finished("The engine is ready.", {"python": str(environment.python), "torch": source.build}))


def _without_repeats(emit: Emit) -> Emit:
    last = (0.0, "")

    def emit_new(event: Event) -> None:
        nonlocal last
        if isinstance(event, Progress):
            now = (event.fraction, event.message)
            if now == last:
                return
            last = now
        emit(event)

    return emit_new


class _Untrusted(EnvironmentProblem):
    """The network shows a certificate that is not trusted, whichever Python asks."""


class _Damaged(EnvironmentProblem):
    """The packages of the environment cannot be used or mended."""


def _install_packages(run: _Run, pythons: Sequence[Path], build: str, packed: Bundle | None) -> tuple[str, TorchSource]:
    """Create the environment where it is missing, install all packages, and return its Python's version and torch."""
    version, source = _create(run, pythons, build, packed)
    _pip_install(run, "packages", locked_arguments(locked_file("engine")))
    run.report("torch", 0.0, f"Installing {source.what}")
    if source.build != build:
        run.emit(Warned("Only a build of torch for NVIDIA graphics cards can be reached; it needs 5 GB more."))
        _require_space(run.environment, source.build)
    _pip_install(run, "torch", source.arguments, one_index=source.one_index)
    run.report("torch", 1.0, "Checking the packages")
    problem = f"a package in {run.environment.root} cannot be imported"
    try:
        run_logged([run.environment.python, "-c", _IMPORTS], run.environment.log, problem, should_stop=run.should_stop)
    except EnvironmentProblem as error:
        raise _Damaged(str(error)) from error
    return version, source


def _create(run: _Run, pythons: Sequence[Path], build: str, packed: Bundle | None) -> tuple[str, TorchSource]:
    """Keep the environment, or create one with the first Python that the wanted build of torch can be had for."""
    run.report("environment", 0.0, "Looking for a Python")
    python = run.environment.python
    present = usable(python) if python.exists() else None
    if present is not None and (packed is None or version_text(present.version) == packed.python):
        if not _works([python, "-m", "pip", "--version"]):
            _add_pip(run)
        return version_text(present.version), _torch(run, build, packed)
    why, refused, other = "", None, None
    for interpreter in find_pythons(pythons):
        if packed is not None and version_text(interpreter.version) != packed.python:
            why = f" ({packed.file.name} is for Python {packed.python})"
            continue
        _create_with(run, interpreter)
        try:
            source = _torch(run, build, packed)
        except _Untrusted:
            raise
        except EnvironmentProblem as error:
            refused = refused or error
            continue
        if source.build == build:
            return version_text(interpreter.version), source
        other = other or (interpreter, source)
    if other is None and refused is not None:
        # Of the network, or of an index: another Python would not help.
        raise refused
    if other is None:
        raise EnvironmentProblem(
            f"No Python that the engine can be installed with was found{why}. {python_advice(VERSIONS)} "
            "Then try again; or name a Python in the preferences."
        )
    interpreter, source = other
    _create_with(run, interpreter)
    return version_text(interpreter.version), source


def _torch(run: _Run, build: str, packed: Bundle | None) -> TorchSource:
    if packed is None:
        return _trusting(run, lambda: torch_source(run.pip, build))
    # Its hash need not be in the locked file; that of the bundle was verified.
    alone = ("--no-deps", "--only-binary", ":all:", pinned(locked_file("torch")))
    return TorchSource(packed.torch, alone, False, f"torch ({packed.torch})")


def _create_with(run: _Run, interpreter: Interpreter) -> None:
    environment = run.environment
    run.report("environment", 0.5, f"Creating an environment with {interpreter.path}")
    delete_derived(environment.folder, environment.root.name)
    command = [interpreter.path, "-m", "venv", *([] if interpreter.has_pip else ["--without-pip"]), environment.root]
    run_logged(
        command, environment.log, f"the environment {environment.root} could not be created",
        should_stop=run.should_stop,
    )  # fmt: skip
    if not interpreter.has_pip:
        _add_pip(run)


def _add_pip(run: _Run) -> None:
    """Install pip with its own wheel."""
    folder = run.environment.folder / "pip"
    wheel = next(run.wheels.glob("pip-*.whl"), None) if run.wheels is not None else None
    try:
        wheel = wheel or fetch_pip(folder)
        # Out of the wheel itself, which can be imported. As a module, because pip refuses on Windows to change itself
        # when it was started in another way.
        command = [run.environment.python, "-m", "pip", "install", "--no-index", "--no-deps", "--force-reinstall"]
        run_logged(
            [*command, "--disable-pip-version-check", wheel], run.environment.log, "pip could not be installed",
            should_stop=run.should_stop, variables={"PYTHONPATH": str(wheel)},
        )  # fmt: skip
    finally:
        delete_derived(run.environment.folder, folder.name)


def _trusting(run: _Run, ask: Callable[[], Answer]) -> Answer:
    """Return what `ask` returns, which uses pip; a pip that is too old for the system's certificates is renewed.

    Raises
    ------
    EnvironmentProblem
        When the certificate of a server is trusted neither by pip nor by the system.
    """
    try:
        return ask()
    except NotTrusted as error:
        refused = error
        if run.pip.version() < _PIP_WITH_TRUSTSTORE:
            try:
                _add_pip(run)
            except EnvironmentProblem as problem:
                # With the system's certificates, too. Another Python would meet the same server.
                raise _Untrusted(str(problem)) from problem
            try:
                return ask()
            except NotTrusted as again:
                refused = again
    if not refused.host:
        raise EnvironmentProblem(str(refused)) from refused
    raise _Untrusted(untrusted_certificate(refused.host, refused.port)) from refused


def _pip_install(run: _Run, step: str, arguments: Sequence[object], *, one_index: bool = False) -> None:
    """Install packages and report each that is downloaded, and how many are installed."""
    files = [Path(str(one)) for one in arguments if isinstance(one, Path)]
    wanted = max(1, sum(len(pins_in(file)) for file in files))
    packages = library_folder(run.environment.root)
    before, collected, message = _count_packages(packages), 0, "Installing the packages"

    def read(line: str) -> None:
        nonlocal collected, message
        collected += bool(_COLLECTING.match(line))
        if found := _DOWNLOADING.match(line):
            message = f"Downloading {found[1].rpartition('/')[2].split('-')[0]} {found[2]}"
        elif line.startswith("Installing collected packages"):
            message = "Unpacking the packages"

    def wait() -> None:
        installed = _count_packages(packages) - before
        run.report(step, 0.5 * (collected + installed) / wanted, message)

    try:
        _trusting(
            run,
            lambda: run.pip.install(
                arguments, one_index=one_index, on_line=read, on_wait=wait, should_stop=run.should_stop
            ),
        )
    except EnvironmentProblem as error:
        # pip cannot replace a package of which an earlier, killed pip has not written the list of files.
        raise _Damaged(str(error)) if "RECORD" in str(error) else error from error


def _count_packages(folder: Path) -> int:
    # Not "**": pip deletes folders meanwhile, and looking into one that disappears fails.
    patterns = ("site-packages/*.dist-info", "python*/site-packages/*.dist-info")
    return sum(1 for pattern in patterns for _ in folder.glob(pattern))


def _fetch_models(run: _Run) -> None:
    """Fetch the model files with the new environment; those that are there are only verified."""
    problem = ""

    def read(line: str) -> None:
        nonlocal problem
        event = from_json_line(line)
        if isinstance(event, Progress):
            run.report("models", event.fraction, event.message)
        elif isinstance(event, ErrorEvent):
            problem = event.message

    source = [] if run.models is None else ["--from", run.models]
    command = engine_command("models", "fetch", *source, "--events", python=run.environment.python)
    try:
        run_logged(
            command, run.environment.log, "the model files could not be fetched", on_line=read,
            should_stop=run.should_stop, variables=engine_environment(other_python=True),
        )  # fmt: skip
    except EnvironmentProblem as error:
        raise EnvironmentProblem(problem) if problem else error from error


def _require_space(environment: EngineEnvironment, build: str) -> None:
    """Raise when the disk has too little space."""
    folder = environment.folder
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free / 1e9
    if free < DISK_GB[build]:
        raise EnvironmentProblem(
            f"{folder} has {free:.1f} GB free, and the engine needs {DISK_GB[build]:.1f} GB. Free some space there."
        )


def _require_short_path(environment: EngineEnvironment) -> None:
    """Raise when the longest file of a package would not fit, as with long names of users on Windows."""
    if not takes_path(environment.folder, environment.root.name / LONGEST_PATH):
        raise EnvironmentProblem(
            f"Files of PyTorch below {environment.folder} would have longer paths than this system allows. Name a "
            f"folder with a shorter path in the environment variable {FOLDER_VARIABLE}, for example C:\\heritage, "
            "start Blender again, and set up the engine there."
        )


def _works(command: Sequence[object]) -> bool:
    return run_text(command).returncode == 0
