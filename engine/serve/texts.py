"""Texts that users enter: without characters that programs, terminals and files take for something else."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from pydantic import AfterValidator

from ..core.visible_text import visible


def _require_visible(text: str, keep: str = "") -> str:
    if visible(text, keep=keep) != text:
        raise ValueError("it holds characters that cannot be shown")
    return text


Line = Annotated[str, AfterValidator(_require_visible)]
Lines = Annotated[str, AfterValidator(partial(_require_visible, keep="\n\r\t"))]
