"""German and French names: the file of the engine, and the script that makes it."""

from __future__ import annotations

from engine.core.words.vocabulary_words import ClassWords, WordList, word_list
from scripts.foreign_words import french, german, rows

DING = """# a comment :: of the list
Krug {m}; Kanne {f} [cook.] | Krüge {pl}; Kannen {pl} | Bierkrug {m} :: jug; pitcher | jugs; pitchers | beer mug
Krug {m} | Krüge {pl} :: jar | jars
Hund {m} [min.] :: jug
Schild {n} :: shield
hämmern {vt} :: drum
Steintopf {m} (alt) :: a {adj} jar
Gift {n} :: jar
"""
INTO_ENGLISH = """cruche /kʀyʃ/ <n, fem>
1. jug, pitcher
2. fool
boire /bwaʀ/ <v>
drum
"""
FROM_ENGLISH = """shield /ʃiːld/
bouclier
drum /dʌm/
1. tambour
2. boire
"""


def known() -> WordList:
    words = ("jug", "pitcher", "jar", "shield", "drum")
    classes = {word: frozenset({number}) for number, word in enumerate(words)}
    return WordList(tuple(ClassWords((word,), word) for word in words), classes)


def test_nouns_of_both_dictionaries_are_kept_with_their_forms_and_without_english_words() -> None:
    found = rows([german(DING.splitlines())], {"gift"}, known())
    assert set(found) == {"Krug", "Krüge", "Kanne", "Kannen", "Schild"}
    assert found["Krug"] == found["Krüge"] == ["jug", "jar", "pitcher"] and found["Kanne"] == ["jug", "pitcher"]
    found = rows([french(INTO_ENGLISH.splitlines(), FROM_ENGLISH.splitlines())], set(), known())
    assert found == {"bouclier": ["shield"], "cruche": ["jug", "pitcher"], "tambour": ["drum"]}


def test_names_of_what_pictures_show_are_left_out_with_their_plurals() -> None:
    """Drachen are kites, and dragons."""
    lines = "Schere {f} | Scheren {pl} :: jar | jars\nSarg {m} | Särge {pl} :: jar | jars\nSargdeckel {m} :: jar\n"
    found = rows([german([*lines.splitlines(), "Drachen {m} :: drum"])], set(), known())
    assert set(found) == {"Sargdeckel", "Drachen"}
    assert not {"Scheren", "Zangen", "Spitzhacken", "Särge", "Boxhandschuhe"} & word_list().foreign.keys()


def test_every_name_of_the_file_means_words_of_the_vocabulary_and_is_none_itself() -> None:
    words = word_list()
    assert len(words.foreign) > 4000
    for name, english in words.foreign.items():
        assert english and all(word in words.classes_of_word for word in english), name
        assert name.lower() not in words.classes_of_word
        assert words.english_of(name) and words.classes_of(name)
