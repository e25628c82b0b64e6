"""A section of a Markdown document is written without touching the text around it."""

from __future__ import annotations

from pathlib import Path

from engine.quality.evaluation.document import write_section


def test_a_section_is_replaced_or_appended_and_the_closing_one_stays_last(tmp_path: Path) -> None:
    doc = tmp_path / "doc.md"
    write_section(doc, introduction="# Figures", title="One", body="1", closing="## Meanings\n\nm")
    write_section(doc, introduction="# Figures", title="Two", body="2", closing="## Meanings\n\nm")
    write_section(doc, introduction="# Figures", title="One", body="11", closing="## Meanings\n\nm")
    assert doc.read_text() == "# Figures\n\n## One\n\n11\n\n## Two\n\n2\n\n## Meanings\n\nm\n"


def test_the_text_above_the_sections_stays_unless_another_is_given(tmp_path: Path) -> None:
    doc = tmp_path / "doc.md"
    doc.write_text("# Training\n\nHow it works.\n\n## One\n\n1\n")
    write_section(doc, title="Two", body="2")
    assert doc.read_text() == "# Training\n\nHow it works.\n\n## One\n\n1\n\n## Two\n\n2\n"
    write_section(doc, introduction="# Other", title="Two", body="3")
    assert doc.read_text().startswith("# Other\n\n## One")


def test_headings_of_the_introduction_are_written_once(tmp_path: Path) -> None:
    doc = tmp_path / "table.md"
    for body in ("first", "second"):
        write_section(doc, introduction="# Detail\n\n## Columns\n\nShort.", title="room", body=body)
    assert doc.read_text(encoding="utf-8") == "# Detail\n\n## Columns\n\nShort.\n\n## room\n\nsecond\n"
