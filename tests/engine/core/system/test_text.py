"""Output of other programs is read whatever the code page of the system is."""

from __future__ import annotations

import io
import json
import sys

import pytest

from engine.core.system import json_printable, printable, run_text


def test_bytes_that_are_no_text_are_no_error() -> None:
    done = run_text([sys.executable, "-c", r"import sys; sys.stdout.buffer.write(b'caf\xe9 \x81')"])
    assert done.returncode == 0 and done.stdout.startswith("caf")


def test_python_writes_utf8() -> None:
    done = run_text([sys.executable, "-c", "print('\\u0141ukasz \\u6771')"])
    assert done.stdout.strip() == "\u0141ukasz \u6771"


@pytest.mark.parametrize("page", ["cp1252", "cp932", "cp1253", "cp1255"])
def test_any_text_can_be_printed_on_any_code_page(page: str) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=page)
    line = json.dumps({"message": "\u0141ukasz \u6771 \u05d0"}, ensure_ascii=False)
    stream.write(json_printable(line, stream) + printable(line, stream))
    assert json.loads(json_printable(line, stream)) == json.loads(line)
