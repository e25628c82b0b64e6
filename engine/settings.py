"""What every room's settings share: bounds checked in one form of words, and a strict way back from JSON.

A settings class is a frozen dataclass in its room's ``settings.py``; defaults are written there and nowhere else.
"""

from __future__ import annotations

import difflib
from dataclasses import asdict, fields, is_dataclass
from typing import Any, TypeVar

from .errors import SettingsError

__all__ = ["from_dict", "require", "to_dict"]

Settings = TypeVar("Settings")


def require(settings: object, field_name: str, condition: bool, bound: str) -> None:
    """Raise `SettingsError` "`TrainingSettings.steps` must be <bound>, got <value>." unless `condition` holds."""
    if not condition:
        value = getattr(settings, field_name)
        raise SettingsError(f"`{type(settings).__name__}.{field_name}` must be {bound}, got {value!r}.")


def to_dict(settings: object) -> dict[str, Any]:
    """Return the settings as plain JSON values, as ``project.json`` stores them."""
    if not is_dataclass(settings) or isinstance(settings, type):
        raise TypeError("settings must be a dataclass instance")
    return asdict(settings)


def from_dict(cls: type[Settings], values: dict[str, Any]) -> Settings:
    """Return `cls` built from `values`; an unknown key is refused and the nearest known one suggested.

    Raises
    ------
    SettingsError
        For an unknown key or a value out of bounds.
    """
    known = [f.name for f in fields(cls)]  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f" Did you mean `{near[0]}`?" if near else f" Known: {', '.join(known)}."
            raise SettingsError(f"`{cls.__name__}` has no setting `{key}`.{hint}")
    return cls(**values)
