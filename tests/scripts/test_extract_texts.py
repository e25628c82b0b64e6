"""The texts that users see are found in the code, and every language has all of them."""

from __future__ import annotations

import re
import sys

import pytest

from tests.engine.command_line import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

import extract_texts  # noqa: E402

SOURCE = '''
class HERITAGE_OT_cut(bpy.types.Operator):
    """Cut the object"""
    bl_label = "Cut"
    shape: str = EnumProperty(name="Shape", description="How", items=[("A", "Round", "As a circle")])
    def draw(self, context):
        self.layout.operator("heritage.cut", text="Cut It")
        self.layout.label(text=f"{1}")
        self.layout.label(text="!")
        self.layout.label(text="Open" if new else name or "Other")
        draw_text(self.layout, translated("{} of {}", 1, 2))
        draw_text(self.layout, "A long line")
class Helper:
    """No text of the interface"""
'''


def test_texts_are_found_with_their_kind() -> None:
    assert sorted(extract_texts.texts_of(SOURCE)) == [
        ("label", "A long line"),
        ("label", "Cut"),
        ("label", "Cut It"),
        ("label", "Open"),
        ("label", "Other"),
        ("label", "Round"),
        ("label", "Shape"),
        ("label", "{} of {}"),
        ("tooltip", "As a circle"),
        ("tooltip", "Cut the object"),
        ("tooltip", "How"),
    ]


def test_texts_of_the_page_are_found() -> None:
    source = """
      // t("no text, a comment is harmless")
      h("p", null, t("Close"), t(isNew ? "Open" : "Say “no”"), plural(n, "{} photo", "{} photos"));
      announce(t("New: {}.", names.join(" and ")));
    """
    assert [text for text in extract_texts.texts_of_script(source) if "comment" not in text] == [
        "Close", "Open", "Say “no”", "{} photo", "{} photos", "New: {}.",
    ]  # fmt: skip


def test_errors_without_a_value_are_found() -> None:
    source = 'raise NotFound("There is none.")\nraise HTTPException(413, f"{name} is too large.")\nraise'
    assert list(extract_texts.answers_of(source)) == ["There is none."]


def test_sentences_are_found_with_the_places_of_their_values() -> None:
    source = """
emit(Progress("masks", done, left, f"Segments of {name}"))
context.tell(0.5, "Storing" if last else f"step {n:,} of {all}")
left_out.append(LeftOut("test photos", f"{count} photos are too few"))
fact = {"what": "steps", "name": "no sentence"}
"""
    assert set(extract_texts.sentences_of(source)) == {
        "steps", "Segments of {}", "Storing", "step {} of {}", "test photos", "{} photos are too few",
    }  # fmt: skip


def test_page_says_nothing_that_is_not_translated() -> None:
    shown: set[str] = set()
    for file in sorted(ROOT.glob(extract_texts.PAGE)):
        code = re.sub(r"(?m)//.*$|/\*.*?\*/", "", file.read_text(encoding="utf-8"))
        # Sentences and labels of several words begin like this; other strings are for the browser.
        shown.update(re.findall(r'(?<=["`])[A-Z][a-z]+ [^"`]*(?=["`])', code))
    assert shown - set(extract_texts.all_texts()) == {"The renderer's shader ${name} has changed."}


@pytest.mark.parametrize("language", sorted(extract_texts.LANGUAGES))
def test_every_text_is_translated_and_none_is_left_empty(language: str) -> None:
    file = extract_texts.LANGUAGES[language]
    known, texts = extract_texts.translated(file), extract_texts.all_texts()
    assert all(text.strip() for text in known.values())
    kinds = list(texts.values())
    assert kinds.count("label") > 100 and kinds.count("tooltip") > 100
    assert sorted(set(texts) - set(known)) == []
    assert sorted(set(known) - set(texts)) == []
    said, sentences = extract_texts.translated(file, "sentences"), extract_texts.all_sentences()
    assert len(sentences) > 50 and set(said) == sentences
    assert [text for text, own in said.items() if text.count("{}") != own.count("{}") or not own.strip()] == []


def test_command_lists_what_is_missing_and_what_is_not_used(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extract_texts, "all_texts", lambda: {"Cut": "label", "Cut the object": "tooltip"})
    monkeypatch.setattr(extract_texts, "all_sentences", lambda: {"step {} of {}"})
    parts = {"texts": {"Cut": "Schneiden", "Gone": "Weg"}, "sentences": {"step {} of {}": "Schritt {} von {}"}}
    monkeypatch.setattr(extract_texts, "translated", lambda file, part: parts[part])
    monkeypatch.setattr(sys, "argv", ["extract_texts.py"])
    assert extract_texts.main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert "# texts without a translation: 1" in lines and '  "Cut the object": "",' in lines
    assert "# sentences without a translation: 0" in lines
    assert lines[lines.index("# translated texts that are not used any more: 1") + 1].strip() == '"Gone"'
