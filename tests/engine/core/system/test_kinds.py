"""Computers without packages for the engine are told so before anything is downloaded."""

from __future__ import annotations

import tomllib

import pytest

from engine.core.system import SYSTEMS, kinds, this_system, unsupported
from tests.conftest import ROOT


@pytest.mark.parametrize(
    ("system", "processor", "macos", "supported"),
    [
        ("win32", "AMD64", "", "windows"), ("win32", "ARM64", "", None), ("darwin", "arm64", "14.6", "macos"),
        ("darwin", "arm64", "13.7", None), ("darwin", "x86_64", "14.6", None), ("linux", "x86_64", "", "linux"),
        ("linux", "aarch64", "", None), ("freebsd14", "amd64", "", None),
    ],
)  # fmt: skip
def test_supported_computers(
    system: str, processor: str, macos: str, supported: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kinds.sys, "platform", system)
    monkeypatch.setattr(kinds.platform, "machine", lambda: processor)
    monkeypatch.setattr(kinds.platform, "mac_ver", lambda: (macos, ("", "", ""), processor))
    found = this_system()
    assert (found.name if found else None) == supported
    assert bool(unsupported()) is (supported is None)
    if supported is None:
        assert processor in unsupported() and all(one.title in unsupported() for one in SYSTEMS.values())


def test_manifest_names_the_same_systems() -> None:
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["platforms"] == [system.blender for system in SYSTEMS.values()]
