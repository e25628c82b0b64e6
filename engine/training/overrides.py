"""Settings of training that a user gives by name for an experiment, as ``name=value``. Standard library only."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..core.errors import SettingsError
from .settings import TrainingSettings

_OWN_OPTION = {"backend": "--device", "train_features": "--no-objects", "transients": "--transients"}
"""Settings that have an option of their own, which decides more than the setting."""

_TYPES: dict[str, type] = {"bool": bool, "int": int, "float": float}
"""By the annotation of a setting; the others are one of several words."""

_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}


def _kinds() -> dict[str, type]:
    """Return the type of each single setting of training, by name."""
    settings = (setting for _, setting in TrainingSettings().single_settings())
    return {setting.name: _TYPES.get(str(setting.type), str) for setting in settings}


def settable_names() -> list[str]:
    """Return the names of the settings that `read_overrides` takes, sorted."""
    return sorted(set(_kinds()) - set(_OWN_OPTION))


def read_overrides(texts: Iterable[str]) -> dict[str, Any]:
    """Return the settings that ``name=value`` texts give, by name, each as the type of its default.

    Raises
    ------
    SettingsError
        When a text has another form, a name is unknown, has an option of its own or is given twice, or a value has
        another type.
    """
    kinds = _kinds()
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise SettingsError(f"--set takes name=value, for example --set lr_means=1e-3, got {text!r}.")
        if name in _OWN_OPTION:
            raise SettingsError(f"`{name}` cannot be given by --set; use the option {_OWN_OPTION[name]}.")
        if name not in kinds:
            raise SettingsError(
                f"Training has no setting `{name}`. --set takes one of these: {', '.join(settable_names())}."
            )
        if name in values:
            raise SettingsError(f"--set gives `{name}` twice; give it once.")
        values[name] = _value(name, value, kinds[name])
    return values


def _value(name: str, text: str, kind: type) -> Any:
    """Return `text` as a value of the type `kind`."""
    try:
        if kind is bool:
            return {"true": True, "false": False}[text.lower()]
        value = kind(text)
        if kind is not float or math.isfinite(value):
            return value
    except (KeyError, ValueError):
        pass
    raise SettingsError(f"The setting `{name}` of training is {_WORDS[kind]}, and --set gives {text!r}.")
