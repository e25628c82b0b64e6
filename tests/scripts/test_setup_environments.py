"""`make setup` installs only files whose hashes are in requirements/, each package from one index."""

from __future__ import annotations

import hashlib
import importlib
import re
import sys
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
CPU, CUDA = {"requires_dist": ["sympy"]}, {"requires_dist": ["nvidia-cublas==13; platform_system == 'Linux'"]}
KNOWN = re.findall(r"sha256:(\w+)", (SCRIPTS.parent / "requirements" / "locked-torch.txt").read_text())[0]


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return importlib.import_module("setup_environments")


@pytest.fixture
def installed(setup: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The arguments of each `pip install`, which is not run; the last one is "one index" where only one is asked."""
    calls: list[list[str]] = []

    def pip(environment: object, arguments: list[object], log: Path, what: str, *, one_index: bool = False) -> None:
        calls.append([*map(str, arguments), *(["one index"] if one_index else [])])

    monkeypatch.setattr(setup, "pip", pip)
    monkeypatch.setattr(setup, "check_disk", lambda torch: None)
    return calls


def _offer(monkeypatch: pytest.MonkeyPatch, setup: ModuleType, configured: Any, own: Any) -> None:
    """Let the configured index and the one on pip's command line offer a file, or nothing."""
    monkeypatch.setattr(setup, "plan", lambda arguments, *_, one_index=False: own if one_index else configured)


def _file(metadata: dict[str, list[str]], sha256: str) -> dict[str, Any]:
    return {"metadata": metadata, "download_info": {"archive_info": {"hashes": {"sha256": sha256}}}}


@pytest.mark.parametrize(
    ("torch", "platform", "configured", "own", "with_hashes", "index"),
    [
        ("cpu", "darwin", _file(CPU, KNOWN), None, True, ""),
        ("cpu", "win32", _file(CUDA, KNOWN), None, True, ""),
        ("cpu", "linux", _file(CPU, "of a mirror"), None, False, ""),
        ("cpu", "linux", _file(CUDA, KNOWN), _file(CPU, "of PyTorch"), False, "cpu"),
        ("cpu", "linux", None, _file(CPU, "of PyTorch"), False, "cpu"),
        ("cpu", "linux", _file(CUDA, KNOWN), None, True, ""),
        ("cuda", "linux", None, None, True, ""),
        ("cuda", "win32", None, None, False, "cu130"),
    ],
)
def test_torch_has_hashes_unless_only_another_index_has_its_build(
    setup: ModuleType, installed: list[list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    torch: str, platform: str, configured: Any, own: Any, with_hashes: bool, index: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(sys, "platform", platform)
    _offer(monkeypatch, setup, configured, own)
    setup.install_torch(setup.ENVIRONMENTS[0], torch, Path("log"))
    (arguments,) = installed
    assert "--no-deps" in arguments
    assert ("--require-hashes" in arguments) is with_hashes
    assert ("one index" in arguments) is bool(index)
    assert not index or arguments[arguments.index("--index-url") + 1].endswith("/whl/" + index)
    # Without hashes, nothing but torch.
    assert with_hashes or arguments[-2 if index else -1].startswith("torch==")


@pytest.mark.parametrize("configured", [_file({}, ""), None], ids=["configured-index", "Blenders-index"])
def test_bpy_comes_alone_from_one_index_with_its_hash(
    setup: ModuleType, installed: list[list[str]], monkeypatch: pytest.MonkeyPatch, configured: Any
) -> None:
    _offer(monkeypatch, setup, configured, None)
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
    for name in ("run", "write_stamp", "drop_other_torch"):
        monkeypatch.setattr(setup, name, lambda *_, **__: None)
    _offer(monkeypatch, setup, _file(CPU, KNOWN), None)
    for environment in setup.ENVIRONMENTS:
        setup.make(environment, Path(sys.executable), "cpu")
    assert len(installed) == 2 * len(setup.ENVIRONMENTS)
    assert all("--require-hashes" in arguments and "--no-deps" in arguments for arguments in installed)


def test_no_second_index_is_ever_added() -> None:
    assert "--extra-index-url" not in (SCRIPTS / "setup_environments.py").read_text()


@pytest.fixture
def wheel(setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package in a folder that is configured as the only source of packages; pip installs nothing."""
    (tmp_path / "wheels").mkdir()
    path = tmp_path / "wheels" / "our_package-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "our_package-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: our-package\nVersion: 1.0\n"
        )
        archive.writestr("our_package-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        archive.writestr("our_package-1.0.dist-info/RECORD", "")
    for name, value in {
        "FIND_LINKS": tmp_path / "wheels",
        "NO_INDEX": 1,
        "DRY_RUN": 1,
        "CONFIG_FILE": "/dev/null",
    }.items():
        monkeypatch.setenv(f"PIP_{name}", str(value))
    monkeypatch.setattr(setup, "REQUIREMENTS", tmp_path)
    monkeypatch.setattr(setup, "python_of", lambda name: sys.executable)
    return path


def test_file_with_another_hash_is_not_installed(setup: ModuleType, wheel: Path, tmp_path: Path) -> None:
    def install(sha256: str) -> None:
        (tmp_path / "locked-ours.txt").write_text(f"our-package==1.0 \\\n    --hash=sha256:{sha256}\n")
        setup.pip(setup.ENVIRONMENTS[0], setup.locked("ours"), tmp_path / "log", "ours")

    install(hashlib.sha256(wheel.read_bytes()).hexdigest())
    assert "Would install our-package-1.0" in (tmp_path / "log").read_text()
    with pytest.raises(setup.SetupProblem, match="pip could not install"):
        install("0" * 64)


def test_index_on_the_command_line_is_the_only_one_asked(
    setup: ModuleType, wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PIP_NO_INDEX")
    (tmp_path / "index" / "our-package").mkdir(parents=True)
    (tmp_path / "index" / "our-package" / "index.html").write_text("<html></html>")
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", (tmp_path / "wheels").as_uri())
    arguments = ["--index-url", (tmp_path / "index").as_uri(), "our-package==1.0"]
    assert setup.plan(arguments) is not None
    assert setup.plan(arguments, one_index=True) is None
