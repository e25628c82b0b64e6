"""Mutations of JSON: values of other types, extreme numbers, names that lead elsewhere, missing and repeated keys."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from typing import Any

_MARK = "@@raw@@"
_RAW = (
    "NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e308", "-1e308", "1e-320", "0", "-0.0", "-1", "1", "2", "0.5",
    "1e15", "1e19", "2147483648", "4294967296", "9223372036854775807", "9223372036854775808", "-9223372036854775809",
    "18446744073709551616", "1" + "0" * 30, "1" + "0" * 400, "9" * 5000, "null", "true", "false", '""', '"x"',
    '"\\ud800"',
    '"\\udcff"', '"\\u0000"', '"\\u001b[2J"', '"\\u202e"', '"../../../x"', '"/etc/passwd"', '"C:\\\\x"', '"."', '".."',
    '"con"', '"' + "x" * 300 + '"', '"' + "x" * 70_000 + '"', '"1e999"', '"nan"', "[]", "{}", "[[]]", "[{}]", "[null]",
    '{"": null}', "[" * 300 + "]" * 300, "[" * 50_000 + "]" * 50_000, '{"a":' * 3000 + "0" + "}" * 3000,
    "[" + "0," * 3000 + "0]", "{" + ",".join(f'"{n}":{n}' for n in range(2000)) + "}", "[", "]", "}", '"', "", "'a'",
    "tru",
    "01", "+1", ".5", "1.", "0x10", "[1,]", '{"a":1,}', "// x", "\x00", "\ufeff1", "1 2",
)  # fmt: skip
"""What is put in the place of a value; some of it is no JSON."""


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path]
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        found += _places(item, (*path, key))
    return found


def _parent(value: Any, path: tuple[Any, ...]) -> Any:
    for key in path[:-1]:
        value = value[key]
    return value


def _changed(data: bytes, rng: random.Random, change: Callable[[Any, Any, random.Random], None]) -> bytes:
    """Apply `change` to the parent and the key of a random value."""
    document = [json.loads(data)]
    path = rng.choice(_places(document)[1:])
    change(_parent(document, path), path[-1], rng)
    return (json.dumps(document[0]) if document else "").encode()


def _replaced(data: bytes, rng: random.Random) -> bytes:
    """Put something from `_RAW` in the place of a value."""

    def change(parent: Any, key: Any, rng: random.Random) -> None:
        parent[key] = _MARK

    text = _changed(data, rng, change).decode()
    return text.replace(f'"{_MARK}"', rng.choice(_RAW)).encode("utf-8", "surrogatepass")


def _removed(data: bytes, rng: random.Random) -> bytes:
    def change(parent: Any, key: Any, rng: random.Random) -> None:
        del parent[key]

    return _changed(data, rng, change)


def _of_another_type(data: bytes, rng: random.Random) -> bytes:
    def change(parent: Any, key: Any, rng: random.Random) -> None:
        value = parent[key]
        choices: list[Any] = [[value], {"a": value}, str(value), None, bool(value), [], {}]
        if isinstance(value, int | float):
            choices += [-value, value * 1e9, value + 0.5, int(value) * 10**20, 1e308 * (value or 1), 10**12]
        if isinstance(value, str):
            choices += [
                value * 2,
                value + "\0",
                f"../{value}",
                f"/{value}",
                value.encode().hex(),
                value.upper(),
                len(value),
            ]
        if isinstance(value, list):
            choices += [
                value * 2,
                value[:-1],
                value[::-1],
                [*value, None],
                [value, value],
                {str(n): one for n, one in enumerate(value)},
            ]
        if isinstance(value, dict):
            choices += [list(value.items()), list(value.values()), {**value, "more": value}, {k: None for k in value}]
        parent[key] = rng.choice(choices)

    return _changed(data, rng, change)


def _swapped(data: bytes, rng: random.Random) -> bytes:
    """Put the copy of one value in the place of another."""
    document = [json.loads(data)]
    places = _places(document)[1:]
    source, target = rng.choice(places), rng.choice(places)
    value = json.loads(json.dumps(_parent(document, source)[source[-1]]))
    _parent(document, target)[target[-1]] = value
    return json.dumps(document[0]).encode()


def _renamed(data: bytes, rng: random.Random) -> bytes:
    def change(parent: Any, key: Any, rng: random.Random) -> None:
        if isinstance(parent, dict):
            value = parent.pop(key)
            parent[rng.choice(("", "x", key + "x", key.upper(), "../x", "__class__", "\ud800", "1", "\0"))] = value

    return _changed(data, rng, change)


def _repeated_key(data: bytes, rng: random.Random) -> bytes:
    """State a key of the outer object twice, the second time with another value."""
    document = json.loads(data)
    key = rng.choice(list(document))
    text = json.dumps(document)
    return f"{text[:-1]}, {json.dumps(key)}: {rng.choice(_RAW)}}}".encode("utf-8", "surrogatepass")


def _in_another_encoding(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("utf-8")
    return rng.choice(
        (text.encode("utf-16"), b"\xef\xbb\xbf" + data, text.encode("utf-32"), data + b"\xff", data + data)
    )


JSON = (_replaced, _replaced, _replaced, _removed, _of_another_type, _of_another_type, _swapped, _renamed,
        _repeated_key, _in_another_encoding)  # fmt: skip
"""Each takes the bytes of a document and a `Random`."""
