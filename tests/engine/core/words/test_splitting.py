"""Prompts of several objects are taken apart as people mean them."""

from __future__ import annotations

import pytest

from engine.core.words import join_texts, split_list, split_texts, word_list

TWO = ["vase", "teapot"]


@pytest.mark.parametrize(
    "prompt",
    [
        "vase;teapot",
        "vase, teapot",
        "vase,teapot",
        "vase and teapot",
        "vase AND teapot",
        "vase & teapot",
        "vase&teapot",
        "vase/teapot",
        "vase / teapot",
        "vase. teapot.",
        "vase.teapot",
        "vase\nteapot",
        "vase\r\nteapot\r\n",
        "vase\tteapot",
        "vase und teapot",
        "vase et teapot",
        "vase or teapot",
        "vase oder teapot",
        "vase and/or teapot",
        "vase + teapot",
        "vase | teapot",
        "vase – teapot",
        "vase, and teapot",
        "vase;; , teapot ;",
        "vase、teapot",
        "vase；teapot",
        "- vase\n- teapot",
        "1. vase\n2. teapot",
        "1) vase\n2) teapot",
        "• vase • teapot",
        "vase and\nteapot",
        "vase\xa0and\xa0teapot",
        "vase as well as teapot",
        "vase? teapot!",
        "vase, teapot, Vase",
        '"vase" "teapot"',
        "'vase' and “teapot”",
        "„vase“, «teapot»",
    ],
)
def test_separators_as_people_type_them_separate(prompt: str) -> None:
    assert split_texts(prompt) == TWO


@pytest.mark.parametrize(
    "text",
    [
        "vase",
        "salt and pepper shaker",
        "Salt & pepper shakers",
        "cup and saucer",
        "cups and saucers",
        "bow and arrow",
        "mortar and pestle",
        "black and gold garden spider",
        "arts and crafts vase",
        "Madonna and Child",
        "a blue and white vase",
        "black, white and red vase",
        "black/white vase",
        "large, old vase",
        "old and new clock",
        "bowl, silver",
        "a Greek vase, with two handles",
        "vase with handles and a lid",
        "statue of Adam and Eve",
        "bowl between the vase and the teapot",
        "No. 5 vase",
        "St. George statue",
        "3.5 cm vase",
        "vase 3,5 cm",
        "1/2 vase",
        "vase w/o lid",
        "AT&T phone",
        "U.S. flag",
        "ship's bell",
        "black-and-tan coonhound",
        "vase (blue, white)",
        '10" plate',
        "Rotkohl-Vase",
        "candlestand",
        "andiron",
        "orchid etagere",
    ],
)
def test_phrase_of_one_object_stays_whole(text: str) -> None:
    assert split_texts(text) == [text]
    assert split_texts(f"{text}; drum") == [text, "drum"]


@pytest.mark.parametrize(
    ("prompt", "texts"),
    [
        ("vase, teapot, and drum", ["vase", "teapot", "drum"]),
        ("a bow and arrow and a shield", ["a bow and arrow", "a shield"]),
        ("blue and white vase and red teapot", ["blue and white vase", "red teapot"]),
        ("cup and saucer, salt & pepper shaker/vase", ["cup and saucer", "salt & pepper shaker", "vase"]),
        ("orange and banana", ["orange", "banana"]),  # not an adjective here
        ("vase with flowers and teapot", ["vase with flowers", "teapot"]),
        ("vase on the left and teapot on the right", ["vase on the left", "teapot on the right"]),
        ("statue of Adam and Eve, vase", ["statue of Adam and Eve", "vase"]),
        ("Vase und Teekanne", ["Vase", "Teekanne"]),
        ('"vase and teapot", drum', ["vase and teapot", "drum"]),
        ("“one, two; three/four” and drum", ["one, two; three/four", "drum"]),
        ("'ship's bell' and vase", ["ship's bell", "vase"]),
        ('10" plate and 12" plate', ['10" plate', '12" plate']),
        ('the "Portland, or Barberini" vase, teapot', ['the "Portland, or Barberini" vase', "teapot"]),
        ("vase (Greek, red), teapot", ["vase (Greek, red)", "teapot"]),
        ("vase 1/vase 2", ["vase 1", "vase 2"]),
        ("and vase and", ["vase"]),
        (" ; ,. ", []),
        ("", []),
    ],
)
def test_lists_with_phrases_and_quotation_marks(prompt: str, texts: list[str]) -> None:
    assert split_texts(prompt) == texts


def test_every_word_of_the_vocabulary_is_one_text() -> None:
    """R.V. loses its last full stop, which no word needs."""
    split = {word: split_texts(word) for word in word_list().classes_of_word}
    assert {word: texts for word, texts in split.items() if texts != [word]} == {"r.v.": ["r.v"]}


@pytest.mark.parametrize(
    "texts",
    [
        TWO,
        ["cup and saucer", "vase"],
        ["vase and teapot", "drum"],
        ["one, two; three/four"],
        ['a "b, c" d', "e/ff gg/hh"],
    ],
)
def test_joined_texts_are_taken_apart_into_the_same(texts: list[str]) -> None:
    assert split_texts(join_texts(texts)) == texts


def test_names_between_semicolons_keep_their_commas_and_lose_blanks() -> None:
    assert split_list(" a, b ;; c;") == ["a, b", "c"]
    assert split_list(" ; ") == []
