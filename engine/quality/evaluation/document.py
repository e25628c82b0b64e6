"""Markdown documents with one section per measurement. Writing one section leaves the others unchanged."""

from __future__ import annotations

from pathlib import Path

from ...core.files import read_text, write_file

_HEADING = "## "


def write_section(path: Path, *, title: str, body: str, introduction: str = "", closing: str = "") -> None:
    """Write one section. It replaces the section of the same title, or is appended.

    Parameters
    ----------
    path : Path
        Created when missing.
    title : str
        Title of the section.
    body : str
        Text of the section without its heading.
    introduction : str
        Text above all sections, with the heading; if empty, that of the file stays.
    closing : str
        Heading and text of a last section that explains the others; none if empty.

    Raises
    ------
    FormatError
        When the file exists and cannot be read.
    DiskError
        When it cannot be written.
    """
    last = closing.partition("\n")[0]
    sections: dict[str, str] = {}
    if path.exists():
        advice = "Its other sections would be lost: repair it, or move it away."
        above, *parts = ("\n" + read_text(path, advice=advice)).split("\n" + _HEADING)
        introduction = introduction or above
        sections = {part.partition("\n")[0]: part.partition("\n")[2].strip() for part in parts}
        # The introduction may have headings of its own.
        sections = {name: text for name, text in sections.items() if f"\n{_HEADING}{name}\n" not in introduction}
    sections[title] = body.strip()
    texts = [f"{_HEADING}{name}\n\n{text}" for name, text in sections.items() if _HEADING + name != last]
    write_file(path, "\n\n".join(text.strip() for text in (introduction, *texts, closing) if text) + "\n")
