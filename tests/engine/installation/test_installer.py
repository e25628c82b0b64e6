"""An installation: from a folder of wheels or a bundle, continued after it was stopped, repaired, refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from engine.errors import Cancelled, EnvironmentProblem, FormatError
from engine.events import Event, Finished, Progress, never_stop
from engine.installation import EngineEnvironment, Pip, TorchSource
from engine.installation import bundle as bundles
from engine.installation import installer as module
from engine.installation.bundle import Bundle, this_platform
from engine.installation.pythons import Interpreter

from .conftest import locked

VERSION = (sys.version_info[0], sys.version_info[1])


@pytest.fixture
def engine(tmp_path: Path, wheels: Path, monkeypatch: pytest.MonkeyPatch) -> EngineEnvironment:
    """An environment of two small packages instead of the engine's."""
    files = {name: locked(wheels, f"our_{what}") for name, what in (("engine", "package"), ("torch", "torch"))}
    monkeypatch.setattr(module, "locked_file", files.__getitem__)
    monkeypatch.setattr(module, "_IMPORTS", "import our_package, our_torch")
    monkeypatch.setattr(module, "_fetch_models", lambda run: None)
    torch = TorchSource("cpu", ("--no-deps", "our-torch"), False, "torch (cpu)")
    monkeypatch.setattr(module, "torch_source", lambda pip, build: torch)
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([Interpreter(_base_python(), VERSION, True)]))
    return EngineEnvironment(tmp_path / "engine")


def _base_python() -> Path:
    return Path(getattr(sys, "_base_executable", sys.executable))


def _install(engine: EngineEnvironment, **options: Any) -> list[Event]:
    events: list[Event] = []
    module.install(engine, **{"build": "cpu", "emit": events.append, "should_stop": never_stop, **options})
    return events


def _runs(engine: EngineEnvironment) -> bool:
    command = [str(engine.python), "-c", "import our_package, our_torch"]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def test_engine_is_ready_and_progress_grows_to_its_end(engine: EngineEnvironment) -> None:
    events = _install(engine)
    assert engine.state() == "ready" and _runs(engine)
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == sorted(fractions) and fractions[0] < 0.05 and fractions[-1] > 0.8
    assert isinstance(events[-1], Finished) and events[-1].outputs["python"] == str(engine.python)


def test_stopped_installation_continues(engine: EngineEnvironment) -> None:
    with pytest.raises(Cancelled):
        _install(engine, should_stop=lambda: True)
    assert engine.state() == "incomplete"
    _install(engine)
    assert engine.state() == "ready" and _runs(engine)


def test_damaged_package_is_mended_by_a_new_environment(engine: EngineEnvironment) -> None:
    _install(engine)
    (damaged,) = engine.root.rglob("our_package.py")
    damaged.write_text("raise RuntimeError")
    (engine.root / "old").touch()
    _install(engine)
    assert _runs(engine) and not (engine.root / "old").exists()


def test_good_environment_is_kept(engine: EngineEnvironment) -> None:
    _install(engine)
    (engine.root / "kept").touch()
    _install(engine)
    assert (engine.root / "kept").exists()


def test_without_a_python_the_sentence_says_what_to_install(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([]))
    with pytest.raises(EnvironmentProblem, match="No Python that the engine can be installed with was found"):
        _install(engine)


def test_python_for_which_torch_can_be_had_is_taken(engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = (Interpreter(_base_python(), version, True) for version in ((3, 99), VERSION))
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([first, second]))
    asked: list[Path] = []

    def source(pip: Pip, build: str) -> TorchSource:
        asked.append(pip.python)
        if len(asked) == 1:
            raise EnvironmentProblem("no torch")
        return TorchSource("cpu", ("--no-deps", "our-torch"), False, "torch (cpu)")

    monkeypatch.setattr(module, "torch_source", source)
    _install(engine)
    assert json.loads((engine.folder / "installed.json").read_text())["python"] == ".".join(map(str, VERSION))


def test_full_disk_is_told_before_anything_is_made(engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(module.DISK_GB, "cpu", 1e9)
    with pytest.raises(EnvironmentProblem, match="GB free"):
        _install(engine)
    assert not engine.folder.exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows runs pip by other means")
def test_python_without_pip_gets_it_from_its_wheel(
    engine: EngineEnvironment, wheels: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ensurepip = Path(__import__("ensurepip").__file__).parent / "_bundled"
    (wheel,) = ensurepip.glob("pip-*.whl")
    monkeypatch.setattr(module, "fetch_pip", lambda folder: wheel)
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([Interpreter(_base_python(), VERSION, False)]))
    _install(engine)
    assert _runs(engine)


def _bundle(wheels: Path, **changes: Any) -> Path:
    file = wheels.parent / "bundle.zip"
    contents = {f"wheels/{path.name}": path.read_bytes() for path in wheels.iterdir()}
    info = {
        "version": 1, "platform": this_platform(), "python": ".".join(map(str, VERSION)), "torch": "cpu",
        "files": {name: bundles.hashlib.sha256(data).hexdigest() for name, data in contents.items()}, **changes,
    }  # fmt: skip
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("bundle.json", json.dumps(info))
        for name, data in contents.items():
            archive.writestr(name, data)
    return file


def test_bundle_needs_no_index(engine: EngineEnvironment, wheels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = _bundle(wheels)
    monkeypatch.setenv("PIP_FIND_LINKS", "")
    monkeypatch.setattr(module, "pinned", lambda file: "our-torch==1.0")
    _install(engine, bundle=file)
    assert engine.state() == "ready" and _runs(engine)
    assert not (engine.folder / "unpacked").exists()


@pytest.mark.parametrize(
    ("changes", "error", "sentence"),
    [
        ({"platform": "amiga-68000"}, EnvironmentProblem, "is for amiga-68000, and this computer is"),
        ({"python": "3.2"}, EnvironmentProblem, r"bundle.zip is for Python 3\.2"),
        ({"version": 9}, FormatError, "another version"),
        ({"files": {"../../evil": "0"}}, FormatError, "which no bundle has"),
        ({"files": {"wheels/gone.whl": "0"}}, FormatError, "is damaged"),
    ],
)
def test_bundle_that_does_not_fit_is_refused(
    engine: EngineEnvironment, wheels: Path, changes: dict[str, Any], error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        _install(engine, bundle=_bundle(wheels, **changes))
    assert engine.state() in ("missing", "incomplete")


def test_changed_file_in_a_bundle_is_found(wheels: Path, tmp_path: Path) -> None:
    file = _bundle(wheels)
    name = next(iter(Bundle.read(file).files))
    file = _bundle(wheels, files={name: "0" * 64})
    with pytest.raises(FormatError, match="another SHA-256"):
        Bundle.read(file).unpack(tmp_path / "unpacked", lambda event: None)
    assert not list((tmp_path / "unpacked").rglob("*.whl"))
