"""Texts that users enter: without characters that programs, terminals and files take for something else."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from ..core.visible_text import visible


def _one_line(text: str) -> str:
    if visible(text) != text:
        raise ValueError("it holds characters that cannot be shown")
    return text


def _several_lines(text: str) -> str:
    if visible(text, keep="\n\r\t") != text:
        raise ValueError("it holds characters that cannot be shown")
    return text


Line = Annotated[str, AfterValidator(_one_line)]
Lines = Annotated[str, AfterValidator(_several_lines)]
