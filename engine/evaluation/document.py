"""A Markdown document that several measurements share: each writes its own section and leaves the others alone."""

from __future__ import annotations

from pathlib import Path

from ..errors import DiskError
from ..project_folder import atomic_write

__all__ = ["write_section"]

_HEADING = "## "


def write_section(path: Path, *, introduction: str, title: str, body: str, closing: str = "") -> None:
    """Write one section; a section of this title is replaced where it stands, a new one comes after the others.

    Parameters
    ----------
    path : Path
        Made if it is not there.
    introduction : str
        What stands above all sections, heading included.
    title : str
        Of the section.
    body : str
        Without its heading; it may have deeper ones.
    closing : str
        Heading and text of the last section, which explains the others; none if empty.

    Raises
    ------
    DiskError
        When the file cannot be read or written.
    """
    last = closing.partition("\n")[0]
    sections: dict[str, str] = {}
    if path.exists():
        try:
            parts = ("\n" + path.read_text(encoding="utf-8")).split("\n" + _HEADING)[1:]
        except (OSError, UnicodeDecodeError) as error:
            raise DiskError(f"{path} cannot be read, so its other sections would be lost: {error}.") from error
        sections = {part.partition("\n")[0]: part.partition("\n")[2].strip() for part in parts}
    sections[title] = body.strip()
    texts = [f"{_HEADING}{name}\n\n{text}" for name, text in sections.items() if _HEADING + name != last]
    with atomic_write(path, "w") as stream:
        stream.write("\n\n".join(text.strip() for text in (introduction, *texts, closing) if text) + "\n")
