"""`make setup` installs only files whose hashes are locked, each package from one index."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from engine.install.environment import Pip, TorchSource

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
TORCH = TorchSource("cpu", ("--no-deps", "torch==1.0"), True, "torch (cpu)")


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return importlib.import_module("setup_environments")


@pytest.fixture
def installed(setup: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The arguments of each `pip install`, which is not run; the last one is "one index" where only one is asked."""
    calls: list[list[str]] = []

    def install(pip: Pip, arguments: list[object], *, one_index: bool = False, **_: Any) -> None:
        calls.append([*map(str, arguments), *(["one index"] if one_index else [])])

    monkeypatch.setattr(Pip, "install", install)
    monkeypatch.setattr(setup, "check_disk", lambda torch: None)
    return calls


def test_torch_comes_from_the_source_that_was_chosen(
    setup: ModuleType, installed: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(setup, "torch_source", lambda pip, build: TORCH)
    setup.install_torch(setup.ENVIRONMENTS[0], "cpu", Path("log"))
    assert installed == [["--no-deps", "torch==1.0", "one index"]]


@pytest.mark.parametrize("configured", [{}, None], ids=["configured-index", "Blenders-index"])
def test_bpy_comes_alone_from_one_index_with_its_hash(
    setup: ModuleType, installed: list[list[str]], monkeypatch: pytest.MonkeyPatch, configured: Any
) -> None:
    monkeypatch.setattr(Pip, "offered", lambda *_, **__: configured)
    for environment in setup.ENVIRONMENTS[1:]:
        installed.clear()
        setup.install_bpy(environment, Path("log"))
        (arguments,) = installed
        assert {"--require-hashes", "--no-deps", str(setup.locked_file(environment.locked[1]))} <= set(arguments)
        assert ("--index-url" in arguments) == ("one index" in arguments) == (configured is None)


def test_all_other_packages_have_hashes(
    setup: ModuleType, installed: list[list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("GAUSSIAN_HERITAGE_VENVS", str(tmp_path))
    for name in ("run_logged", "write_stamp", "drop_other_torch"):
        monkeypatch.setattr(setup, name, lambda *_, **__: None)
    monkeypatch.setattr(setup, "torch_source", lambda pip, build: TORCH)
    monkeypatch.setattr(Pip, "offered", lambda *_, **__: {})
    for environment in setup.ENVIRONMENTS:
        setup.make(environment, Path(sys.executable), "cpu")
    others = [arguments for arguments in installed if "torch==1.0" not in arguments]
    locked = [name for environment in setup.ENVIRONMENTS for name in environment.locked]
    assert len(others) == len([name for name in locked if name not in ("torch", "cuda")])
    assert all("--require-hashes" in arguments and "--no-deps" in arguments for arguments in others)


def test_each_further_blender_needs_more_free_space(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("GAUSSIAN_HERITAGE_VENVS", str(tmp_path))
    monkeypatch.setattr(setup.shutil, "disk_usage", lambda _: SimpleNamespace(free=6.5e9))
    setup.check_disk("cpu", n_blenders=1)
    with pytest.raises(setup.SetupProblem, match="6.5 GB free and set-up needs 8 GB"):
        setup.check_disk("cpu", n_blenders=3)


@pytest.mark.parametrize("system", ["linux-x86_64", "win32-amd64"])
def test_libraries_of_a_desktop_that_linux_lacks_are_named_with_their_packages(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    def load(name: str) -> None:
        if name in ("libX11.so.6", "libSM.so.6"):
            raise OSError(name)

    monkeypatch.setattr(setup.ctypes, "CDLL", load)
    monkeypatch.setattr(setup, "package_system", lambda: system)
    if system.startswith("linux"):
        with pytest.raises(setup.SetupProblem, match="apt-get install libx11-6 libsm6\\)"):
            setup.check_libraries()
        monkeypatch.setattr(setup.ctypes, "CDLL", lambda name: None)
    setup.check_libraries()


def test_no_second_index_is_ever_added() -> None:
    sources = [SCRIPTS / "setup_environments.py", *(SCRIPTS.parent / "engine" / "install" / "environment").glob("*.py")]
    assert len(sources) > 5
    assert not any("--extra-index-url" in source.read_text() for source in sources)


def test_each_blender_of_the_list_has_its_packages_and_no_other_has(setup: ModuleType) -> None:
    blenders = [f"blender-{version}" for version in importlib.import_module("places").BLENDERS]
    assert [environment.name for environment in setup.ENVIRONMENTS[1:]] == blenders
    assert sorted(file.stem for file in setup.REQUIREMENTS.glob("blender-*.txt")) == blenders
    assert all(file.is_file() for environment in setup.ENVIRONMENTS for file in environment.files())
