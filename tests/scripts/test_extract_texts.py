"""The texts of Blender's interface are found in the code, and German has nearly all of them."""

from __future__ import annotations

import sys

import pytest

from tests.engine.command_line import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

import extract_texts  # noqa: E402

SOURCE = '''
class HERITAGE_OT_cut(bpy.types.Operator):
    """Cut the object"""
    bl_label = "Cut"
    shape: Annotated[str, EnumProperty(name="Shape", description="How", items=[("A", "Round", "As a circle")])]
    def draw(self, context):
        self.layout.operator("heritage.cut", text="Cut It")
        self.layout.label(text=f"{1}")
        self.layout.label(text="!")
class Helper:
    """No text of the interface"""
'''


def test_texts_are_found_with_their_kind() -> None:
    assert sorted(extract_texts.texts_of(SOURCE)) == [
        ("label", "Cut"),
        ("label", "Cut It"),
        ("label", "Round"),
        ("label", "Shape"),
        ("tooltip", "As a circle"),
        ("tooltip", "Cut the object"),
        ("tooltip", "How"),
    ]


@pytest.mark.parametrize("language", sorted(extract_texts.LANGUAGES))
def test_most_texts_are_translated_and_none_is_left_empty(language: str) -> None:
    known, texts = extract_texts.translated(extract_texts.LANGUAGES[language]), extract_texts.all_texts()
    assert all(text.strip() for text in known.values())
    labels = [text for text, kind in texts.items() if kind == "label"]
    tooltips = [text for text, kind in texts.items() if kind == "tooltip"]
    assert len(labels) > 100 and len(tooltips) > 100
    # What is not translated is shown in English; `scripts/extract_texts.py` lists it.
    assert sum(text in known for text in labels) >= 0.85 * len(labels)
    assert sum(text in known for text in tooltips) >= 0.5 * len(tooltips)


def test_command_lists_what_is_missing_and_what_is_not_used(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extract_texts, "all_texts", lambda: {"Cut": "label", "Cut the object": "tooltip"})
    monkeypatch.setattr(extract_texts, "translated", lambda file: {"Cut": "Schneiden", "Gone": "Weg"})
    monkeypatch.setattr(sys, "argv", ["extract_texts.py"])
    assert extract_texts.main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert "# labels without a translation: 0" in lines and "    'Cut the object': ''," in lines
    assert lines[-1].strip() == "'Gone'"
