"""The shape of a JSON value, checked before any code uses it.

Our own, because Blender's Python has no validation library and an extension should not bring one for this.
"""

from __future__ import annotations

import math
from typing import Any

Schema = Any
"""The schema of a JSON value:

- ``str``, ``bool``, ``int``, ``float`` (any finite number) or ``None``; ``dict``, ``list`` or ``object`` (anything);
- ``[item]``: a list whose items are all `item`;
- ``{"key": value, "other": optional(value)}``: an object with these keys; other keys are allowed;
- ``{str: value}``: an object whose values are all `value`;
- ``(float, None)``: one of these.
"""

_NAMES = {
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a finite number",
    dict: "an object",
    list: "a list",
    None: "null",
}
_MAX_INTEGER = 1 << 63


class optional:  # noqa: N801 reads as a word in a schema
    """A key that may be missing."""

    def __init__(self, schema: Schema) -> None:
        self.schema = schema


def check(value: Any, schema: Schema, place: str = "") -> str | None:
    """Return what is wrong with `value`, with its place in the file; None when it is what `schema` says."""
    if isinstance(schema, tuple):
        if any(check(value, one, place) is None for one in schema):
            return None
        # The last alternative that has content explains best what is wrong inside of it.
        inside = next((one for one in schema if type(one) is type(value) and isinstance(one, dict | list)), None)
        if inside is not None:
            return check(value, inside, place)
        return _not(place, " or ".join(_name(one) for one in schema), value)
    if isinstance(schema, dict):
        return _check_object(value, schema, place)
    if isinstance(schema, list):
        if not isinstance(value, list):
            return _not(place, "a list", value)
        found = (check(item, schema[0], f"{place}[{number}]") for number, item in enumerate(value))
        return next((problem for problem in found if problem), None)
    return None if _is(value, schema) else _not(place, _name(schema), value)


def _check_object(value: Any, schema: dict[Any, Schema], place: str) -> str | None:
    if not isinstance(value, dict):
        return _not(place, "an object", value)
    if str in schema:
        found = (check(item, schema[str], _inside(place, key)) for key, item in value.items())
        return next((problem for problem in found if problem), None)
    for key, expected in schema.items():
        wanted = expected.schema if isinstance(expected, optional) else expected
        if key in value:
            problem = check(value[key], wanted, _inside(place, key))
            if problem:
                return problem
        elif not isinstance(expected, optional):
            return f"`{_inside(place, key)}` is missing"
    return None


def _is(value: Any, schema: Schema) -> bool:
    if schema is object:
        return True
    if schema is None:
        return value is None
    if schema is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and _is_small(value)
    if schema is int:
        return isinstance(value, int) and not isinstance(value, bool) and abs(value) < _MAX_INTEGER
    return isinstance(value, schema)


def _is_small(value: float) -> bool:
    return abs(value) < _MAX_INTEGER if isinstance(value, int) else math.isfinite(value)


def _name(schema: Schema) -> str:
    if isinstance(schema, dict):
        return _NAMES[dict]
    return _NAMES[list] if isinstance(schema, list) else _NAMES[schema]


def _not(place: str, wanted: str, value: Any) -> str:
    text = repr(value)
    found = text if len(text) <= 40 else f"{text[:37]}..."
    return f"`{place}` must be {wanted}, got {found}" if place else f"it must be {wanted}, got {found}"


def _inside(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
