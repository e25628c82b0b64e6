"""Shared by the settings of all packages: bounds checked in one form of words, and their form in ``project.json``.

Settings are frozen dataclasses in the package that reads them; defaults are written there and nowhere else.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from .errors import SettingsError


def require(settings: object, field_name: str, condition: bool, bound: str) -> None:
    """Raise `SettingsError` "`TrainingSettings.steps` must be <bound>, got <value>." unless `condition` holds."""
    if not condition:
        value = getattr(settings, field_name)
        raise SettingsError(f"`{type(settings).__name__}.{field_name}` must be {bound}, got {value!r}.")


def require_choices(settings: object) -> None:
    """Raise `SettingsError` unless each setting whose type is a `Literal` has one of its values."""
    kind: Any = type(settings)  # mypy takes no type[object] for hashable
    for name, allowed in _choices_of(kind).items():
        require(settings, name, getattr(settings, name) in allowed, f"one of {', '.join(map(str, allowed))}")


@functools.cache
def _choices_of(kind: type) -> Mapping[str, tuple[object, ...]]:
    return {name: get_args(hint) for name, hint in get_type_hints(kind).items() if get_origin(hint) is Literal}


def to_dict(settings: object) -> dict[str, Any]:
    """Return the settings as plain JSON values, as ``project.json`` stores them and stage keys hash them.

    Parameters
    ----------
    settings : dataclass instance
        The fields of a nested group of settings are stored beside its own, without the group's name.
    """
    if not is_dataclass(settings) or isinstance(settings, type):
        raise TypeError("settings must be a dataclass instance")
    values: dict[str, Any] = {}
    for setting in fields(settings):
        value = getattr(settings, setting.name)
        if is_dataclass(value):
            values.update(to_dict(value))
        else:
            values[setting.name] = value
    return values
