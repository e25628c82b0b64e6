"""Exit codes say what ended a process, on each system by its own rules."""

from __future__ import annotations

import sys

import pytest

from engine.core.system import exit_cause, killed_for_memory, killed_for_time, limits


@pytest.mark.parametrize("system", sorted({"win32", sys.platform}))
def test_success_is_no_timeout_on_any_system(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has no SIGALRM, whose number a timeout was recognised by."""
    monkeypatch.setattr(limits.sys, "platform", system)
    assert not any(killed(0) for killed in (killed_for_time, killed_for_memory))


@pytest.mark.parametrize(
    ("code", "memory", "cause"),
    [
        (1, False, "exit code 1"),
        (0xC0000005, False, "exit code 0xc0000005"),
        (0xC0000017, True, "exit code 0xc0000017"),
    ],
)
def test_codes_of_windows_are_named_as_in_its_tables(
    code: int, memory: bool, cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits.sys, "platform", "win32")
    assert (killed_for_memory(code), exit_cause(code)) == (memory, cause)
