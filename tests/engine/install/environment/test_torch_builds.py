"""The build of torch: with hashes where they are known, and alone where they are not."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import EnvironmentProblem
from engine.install.environment import Pip, default_build, locked_file, torch_source
from engine.install.environment.locked import hashes_in

CPU, CUDA = {"requires_dist": ["sympy"]}, {"requires_dist": ["nvidia-cublas==13; platform_system == 'Linux'"]}
KNOWN = sorted(hashes_in(locked_file("torch")))[0]


def _file(metadata: dict[str, list[str]], sha256: str) -> dict[str, Any]:
    return {"metadata": metadata, "download_info": {"archive_info": {"hashes": {"sha256": sha256}}}}


def _offer(monkeypatch: pytest.MonkeyPatch, configured: Any, own: Any) -> Pip:
    """Let the configured index and the one on pip's command line offer a file, or nothing."""

    def offered(self: Pip, arguments: Any, *, one_index: bool = False, elsewhere: bool = False) -> Any:
        return own if one_index else configured

    monkeypatch.setattr(Pip, "offered", offered)
    return Pip(Path(sys.executable), Path("log"))


@pytest.mark.parametrize(
    ("build", "platform", "configured", "own", "with_hashes", "index", "chosen"),
    [
        ("cpu", "darwin", _file(CPU, KNOWN), None, True, "", "cpu"),
        ("cpu", "win32", _file(CUDA, KNOWN), None, True, "", "cpu"),
        ("cpu", "linux", _file(CPU, "of a mirror"), None, False, "", "cpu"),
        ("cpu", "linux", _file(CUDA, KNOWN), _file(CPU, "of PyTorch"), False, "cpu", "cpu"),
        ("cpu", "linux", None, _file(CPU, "of PyTorch"), False, "cpu", "cpu"),
        ("cpu", "linux", _file(CUDA, KNOWN), None, True, "", "cuda"),
        ("cuda", "linux", None, None, True, "", "cuda"),
        ("cuda", "win32", None, None, False, "cu130", "cuda"),
    ],
)
def test_torch_has_hashes_unless_only_another_index_has_its_build(
    monkeypatch: pytest.MonkeyPatch, build: str, platform: str, configured: Any, own: Any, with_hashes: bool,
    index: str, chosen: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(sys, "platform", platform)
    source = torch_source(_offer(monkeypatch, configured, own), build)
    arguments = [str(one) for one in source.arguments]
    assert source.build == chosen
    assert "--no-deps" in arguments
    assert ("--require-hashes" in arguments) is with_hashes
    assert source.one_index is bool(index)
    assert not index or arguments[arguments.index("--index-url") + 1].endswith("/whl/" + index)
    # Without hashes, nothing but torch.
    assert with_hashes or arguments[-1].startswith("torch==")


def test_no_index_with_torch_is_told_with_the_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(EnvironmentProblem, match=r"offers torch==.* for .*python"):
        torch_source(_offer(monkeypatch, None, None), "cpu")


def test_apple_computers_get_the_one_build_that_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert default_build() == "cpu"
