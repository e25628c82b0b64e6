"""An installation: from a folder of wheels or a bundle, continued after it was stopped, repaired, refused."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from engine.core.errors import Cancelled, EnvironmentProblem, FormatError
from engine.core.events import Event, Finished, Progress, never_stop
from engine.core.system import SYSTEMS, package_system, python_advice
from engine.install.environment import EngineEnvironment, Pip, TorchSource
from engine.install.environment import bundle as bundles
from engine.install.environment import installer as module
from engine.install.environment.bundle import Bundle
from engine.install.environment.locked import locked_file as real_locked_file
from engine.install.environment.pip_command import NotTrusted
from engine.install.environment.pythons import Interpreter, usable
from engine.install.environment.target import Target

from .conftest import base_python, locked

advice_module = importlib.import_module("engine.core.system.distributions")
VERSION = (sys.version_info[0], sys.version_info[1])
REALLY_CREATE = module._create_with


@pytest.fixture
def engine(tmp_path: Path, wheels: Path, empty: Path, monkeypatch: pytest.MonkeyPatch) -> EngineEnvironment:
    """An environment of two small packages instead of the engine's; what is created is a copy of `empty`."""

    def copy(run: Any, interpreter: Interpreter) -> None:
        shutil.rmtree(run.environment.root, ignore_errors=True)
        shutil.copytree(empty, run.environment.root, symlinks=True)

    monkeypatch.setattr(module, "_create_with", copy)
    files = {name: locked(wheels, f"our_{what}") for name, what in (("engine", "package"), ("torch", "torch"))}
    monkeypatch.setattr(module, "locked_file", files.__getitem__)
    monkeypatch.setattr(module, "_IMPORTS", "import our_package, our_torch")
    monkeypatch.setattr(module, "_fetch_models", lambda run: None)
    torch = TorchSource("cpu", ("--no-deps", "our-torch"), False, "torch (cpu)")
    monkeypatch.setattr(module, "torch_source", lambda pip, build: torch)
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([Interpreter(base_python(), VERSION, True)]))
    return EngineEnvironment(tmp_path / "engine")


def _install(engine: EngineEnvironment, **options: Any) -> list[Event]:
    events: list[Event] = []
    module.install(engine, **{"build": "cpu", "emit": events.append, "should_stop": never_stop, **options})
    return events


def _runs(engine: EngineEnvironment) -> bool:
    command = [str(engine.python), "-c", "import our_package, our_torch"]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def test_engine_is_ready_and_progress_grows_to_its_end(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_create_with", REALLY_CREATE)
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


def test_new_environment_that_cannot_be_used_is_not_made_twice(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_IMPORTS", "import our_package, a_library_that_the_system_lacks")
    made: list[Path] = []
    make = module._create_with
    monkeypatch.setattr(module, "_create_with", lambda run, python: (made.append(python.path), make(run, python)))
    with pytest.raises(EnvironmentProblem, match="a_library_that_the_system_lacks"):
        _install(engine)
    assert len(made) == 1


@pytest.mark.parametrize("what", ["unsupported", "missing_runtime"])
def test_what_the_computer_lacks_is_told_before_anything_is_made(
    what: str, engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, what, lambda: "Windows lacks msvcp140.dll. Install it.")
    with pytest.raises(EnvironmentProblem, match=r"lacks msvcp140\.dll"):
        _install(engine)
    assert not engine.folder.exists()


def test_too_long_paths_are_told_before_anything_is_downloaded(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "takes_path", lambda folder, longest: len(str(folder / longest)) < 200)
    with pytest.raises(EnvironmentProblem, match="longer paths than this system allows"):
        _install(engine)
    assert not engine.root.exists()


@pytest.mark.parametrize("page", ["cp932", "cp1253", "cp1255", "cp874"])
def test_python_is_found_below_a_folder_with_accents_on_any_code_page(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Python that ignores our environment variables writes in the code page of its system."""
    path = "C:/Users/Jos\u00e9 \u0141ukasz/python.exe"
    code = module.usable.__globals__["_PROBE"]
    script = tmp_path / "python"
    script.write_text(
        f"#!{sys.executable}\nimport sys\nsys.stdout.reconfigure(encoding={page!r}, errors='backslashreplace')\n"
        f"sys.executable = {path!r}\nexec({code!r})\n",
        encoding="utf-8",
    )
    script.chmod(0o755)
    if package_system().startswith("win32"):
        pytest.skip("Windows starts no scripts")
    found = usable(script)
    assert found is not None and found.path == Path(path)


LOCKED = """# Made by a test.
both==1.0 \\
    --hash=sha256:aa
windows-only==2.0 ; sys_platform == 'win32' \\
    --hash=sha256:bb
apple-only==3.0 ; platform_machine == 'arm64' and sys_platform == 'darwin' \\
    --hash=sha256:cc
old==4.0 ; python_full_version < '3.12' \\
    --hash=sha256:dd
"""


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("system", "version", "names"),
    [
        ("windows", "3.11", ["both", "windows-only", "old"]), ("windows", "3.13", ["both", "windows-only"]),
        ("macos", "3.13", ["both", "apple-only"]), ("linux", "3.12", ["both"]),
    ],
)  # fmt: skip
def test_bundle_for_another_system_has_the_packages_of_that_system(
    system: str, version: str, names: list[str], line_end: str, tmp_path: Path
) -> None:
    (tmp_path / "locked.txt").write_text(LOCKED, encoding="utf-8", newline=line_end)
    text = Target(SYSTEMS[system], version).requirements(tmp_path / "locked.txt")
    assert [line.partition("==")[0] for line in text.splitlines() if "==" in line] == names
    assert text.count("--hash=sha256:") == len(names) and ";" not in text


def test_locked_packages_have_files_for_each_system() -> None:
    """Each entry of our own list is kept or left out as a whole, with its hashes."""
    for system in SYSTEMS.values():
        text = Target(system, "3.11").requirements(real_locked_file("engine"))
        assert "torch==" not in text and text.count("==") > 30 and "--hash" in text.splitlines()[-1]


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


def test_old_pip_is_renewed_where_the_network_inspects_connections_and_the_certificate_is_named(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    renewed: list[Path] = []
    monkeypatch.setattr(module, "_add_pip", lambda run: renewed.append(run.environment.python))
    monkeypatch.setattr(module, "_PIP_WITH_TRUSTSTORE", (99,))
    monkeypatch.setattr(module, "untrusted_certificate", lambda host, port: f"A certificate of Museum IT for {host}.")
    torch = module.torch_source

    def source(pip: Pip, build: str) -> TorchSource:
        if len(renewed) < trusted_after:
            raise NotTrusted("refused", "HTTPSConnectionPool(host='pypi.org', port=443)")
        return torch(pip, build)

    monkeypatch.setattr(module, "torch_source", source)
    trusted_after = 2
    with pytest.raises(EnvironmentProblem, match=r"^A certificate of Museum IT for pypi\.org\.$"):
        _install(engine)
    assert len(renewed) == 1
    trusted_after = 1
    _install(engine)
    assert engine.state() == "ready" and len(renewed) == 1


def test_server_that_the_system_does_not_trust_is_named_where_pip_would_be_renewed(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def untrusted(*_: Any) -> None:
        raise NotTrusted("refused", "HTTPSConnectionPool(host='pypi.org', port=443)")

    def fetched(folder: Path) -> Path:
        raise EnvironmentProblem("A certificate of Museum IT.")

    monkeypatch.setattr(module, "_PIP_WITH_TRUSTSTORE", (99,))
    monkeypatch.setattr(module, "torch_source", untrusted)
    monkeypatch.setattr(module, "fetch_pip", fetched)
    with pytest.raises(EnvironmentProblem, match=r"^A certificate of Museum IT\.$"):
        _install(engine)


def test_without_a_network_no_other_python_is_advised(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreachable(*_: Any) -> None:
        raise EnvironmentProblem("No index offers torch. Check the network.")

    monkeypatch.setattr(module, "torch_source", unreachable)
    with pytest.raises(EnvironmentProblem, match=r"^No index offers torch\. Check the network\.$"):
        _install(engine)


SYSTEMS_OF_PYTHON = {
    "win32": ((), "python.org (Windows installer"),
    "darwin": ((), "python.org (macOS"),
    "debian": (("apt-get", "apt-cache"), "sudo apt-get install python3.13-venv."),
    "fedora": (("dnf",), "sudo dnf install python3.11"),
    "suse": (("zypper",), "sudo zypper install python311"),
    "other": ((), "uv python install 3.11"),
}


@pytest.mark.parametrize("system", SYSTEMS_OF_PYTHON)
def test_advice_on_python_is_true_on_this_system(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    programs, words = SYSTEMS_OF_PYTHON[system]
    monkeypatch.setattr(advice_module.sys, "platform", system if system in ("win32", "darwin") else "linux")
    monkeypatch.setattr(advice_module.shutil, "which", lambda name: name if name in programs else None)
    shown = {"python3.13-venv": "Package: python3.13-venv"}
    monkeypatch.setattr(advice_module, "run_text", lambda command: SimpleNamespace(stdout=shown.get(command[-1], "")))
    advice = python_advice(((3, 11), (3, 12), (3, 13)))
    assert words in advice and ("python.org" in advice) == (system in ("win32", "darwin"))


def test_python_for_which_torch_can_be_had_is_taken(engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = (Interpreter(base_python(), version, True) for version in ((3, 99), VERSION))
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([first, second]))
    asked: list[Path] = []

    def source(pip: Pip, build: str) -> TorchSource:
        asked.append(pip.python)
        if len(asked) == 1:
            raise EnvironmentProblem("no torch")
        return TorchSource("cpu", ("--no-deps", "our-torch"), False, "torch (cpu)")

    monkeypatch.setattr(module, "torch_source", source)
    _install(engine)
    assert json.loads((engine.folder / "installed.json").read_text(encoding="utf-8"))["python"] == ".".join(
        map(str, VERSION)
    )


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
    monkeypatch.setattr(module, "_create_with", REALLY_CREATE)
    monkeypatch.setattr(module, "fetch_pip", lambda folder: wheel)
    monkeypatch.setattr(module, "find_pythons", lambda preferred: iter([Interpreter(base_python(), VERSION, False)]))
    _install(engine)
    assert _runs(engine)


def _bundle(wheels: Path, **changes: Any) -> Path:
    file = wheels.parent / "bundle.zip"
    contents = {f"wheels/{path.name}": path.read_bytes() for path in wheels.iterdir()}
    info = {
        "version": 1, "platform": package_system(), "python": ".".join(map(str, VERSION)), "torch": "cpu",
        "files": {name: bundles.hashlib.sha256(data).hexdigest() for name, data in contents.items()}, **changes,
    }  # fmt: skip
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("bundle.json", json.dumps(info))
        for name, data in contents.items():
            archive.writestr(name, data)
    return file


def test_bundle_of_the_same_files_has_the_same_bytes(
    wheels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where they were downloaded at another time, in another order."""
    orders = iter([sorted(wheels.glob("*.whl")), sorted(wheels.glob("*.whl"), reverse=True)])

    def download(pip: Pip, arguments: object, folder: Path, *, one_index: bool = False) -> None:
        folder.mkdir(exist_ok=True)
        for number, file in enumerate(order):
            (folder / file.name).write_bytes(file.read_bytes())
            os.utime(folder / file.name, (number + 1e9 + len(written), number + 1e9))

    monkeypatch.setattr(Pip, "download", download)
    monkeypatch.setattr(bundles, "torch_source", lambda *arguments: TorchSource("cpu", (), False, "torch (cpu)"))
    monkeypatch.setattr(bundles, "CATALOGUE", {})
    written: list[bytes] = []
    for order in orders:
        out = tmp_path / f"{len(written)}.zip"
        made = bundles.write_bundle(out, base_python(), tmp_path, "cpu", list[Event]().append, system=SYSTEMS["linux"])
        assert len(made.files) == len(order)
        written.append(out.read_bytes())
    assert written[0] == written[1]


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
