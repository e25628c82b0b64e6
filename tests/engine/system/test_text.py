"""Output of other programs is read whatever the code page of the system is."""

from __future__ import annotations

import sys

from engine.system import run_text


def test_bytes_that_are_no_text_are_no_error() -> None:
    done = run_text([sys.executable, "-c", r"import sys; sys.stdout.buffer.write(b'caf\xe9 \x81')"])
    assert done.returncode == 0 and done.stdout.startswith("caf")


def test_python_writes_utf8() -> None:
    done = run_text([sys.executable, "-c", "print('\\u0141ukasz \\u6771')"])
    assert done.stdout.strip() == "\u0141ukasz \u6771"
