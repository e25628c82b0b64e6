"""The shape of stored JSON is checked, and the message names the place."""

import pytest

from engine.core.errors import FormatError
from engine.core.files import optional, parse_json

CAMERA = {"version": int, "cameras": [{"photo": str, "focal": float, "note": optional((str, None))}]}


def read(text, schema=CAMERA):
    return parse_json(text, schema, source="cameras.json", advice="Run again.")


def test_a_value_of_the_right_shape_is_returned_with_its_other_keys():
    value = read('{"version": 1, "cameras": [{"photo": "a.jpg", "focal": 3, "more": []}], "x": 1}')
    assert value["cameras"][0] == {"photo": "a.jpg", "focal": 3, "more": []}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('{"version": 1}', "`cameras` is missing"),
        ('{"version": true, "cameras": []}', "`version` must be a whole number, got True"),
        ('{"version": 1, "cameras": {}}', "`cameras` must be a list, got {}"),
        ('{"version": 1, "cameras": [{"photo": 1, "focal": 1}]}', "`cameras[0].photo` must be a text, got 1"),
        ('{"version": 1, "cameras": [{"photo": "a", "focal": 1e999}]}', "must be a finite number"),
        ('{"version": 1, "cameras": [{"photo": "a", "focal": NaN}]}', "NaN is not a JSON number"),
        ('{"version": 1, "cameras": [{"photo": "a", "focal": 1, "note": 2}]}', "must be a text or null"),
        ('{"version": 1, "cameras": [{"photo": "\\ud800", "focal": 1}]}', "character that is not valid"),
        ("[" * 100_000 + "]" * 100_000, "nested too deeply"),
        ("[" + "[]," * 4_000_000 + "[]]", "too large"),
        ("1" * 5000, "cannot be read"),
        ("", "cannot be read"),
        ("[]", "it must be an object, got []"),
    ],
)
def test_what_is_wrong_is_one_sentence_with_the_place(text, problem):
    with pytest.raises(FormatError) as caught:
        read(text)
    assert problem in str(caught.value) and str(caught.value).startswith("cameras.json cannot be read: ")
    assert str(caught.value).endswith("Run again.")


@pytest.mark.parametrize("number", ["1e999", "-1e309", "1" * 400 + ".0", "1" * 300 + "e99"])
def test_no_number_is_infinite_where_the_schema_allows_everything(number):
    with pytest.raises(FormatError):
        read(f'{{"a": [{number}]}}', {"a": list})


def test_large_numbers_that_are_finite_are_read():
    assert read('{"a": [1e300, 1e-400, 12e10]}', {"a": list}) == {"a": [1e300, 0.0, 12e10]}


def test_every_value_of_a_mapping_is_checked():
    assert read('{"a": 1, "b": 2.5}', {str: float}) == {"a": 1, "b": 2.5}
    with pytest.raises(FormatError, match="`b` must be a finite number, got 'x'"):
        read('{"a": 1, "b": "x"}', {str: float})
