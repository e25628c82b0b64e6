"""Native libraries see an environment variable that is set while the program runs, on Windows too."""

from __future__ import annotations

import ctypes
import os
import sys

import pytest

from engine.core.system import variable_for_libraries

NAME = "GAUSSIAN_HERITAGE_TEST_VARIABLE"


def seen_by_libraries() -> str | None:
    """Return the variable as C code reads it: on Windows with the runtime of programs made with mingw."""
    runtime = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
    runtime.getenv.restype = ctypes.c_char_p
    found = runtime.getenv(NAME.encode())
    return None if found is None else found.decode()


@pytest.mark.parametrize("before", [None, "the user's"])
def test_variable_is_seen_by_libraries_until_the_block_ends(
    before: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(NAME, raising=False)
    if before is not None:
        monkeypatch.setenv(NAME, before)
    with pytest.raises(ZeroDivisionError), variable_for_libraries(NAME, "a;b|c"):
        assert os.environ[NAME] == "a;b|c" == seen_by_libraries()
        raise ZeroDivisionError
    assert os.environ.get(NAME) == before == seen_by_libraries()
