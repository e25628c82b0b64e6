"""Checks that the groups of training settings share."""

from __future__ import annotations

from ..core.settings import require


def require_at_least(settings: object, smallest: int, *names: str) -> None:
    """Raise `SettingsError` unless the named settings are at least `smallest`."""
    for name in names:
        require(settings, name, getattr(settings, name) >= smallest, f"at least {smallest}")


def require_positive(settings: object, *names: str) -> None:
    """Raise `SettingsError` unless the named settings are greater than 0."""
    for name in names:
        require(settings, name, getattr(settings, name) > 0, "greater than 0")


def require_fraction(settings: object, *names: str) -> None:
    """Raise `SettingsError` unless the named settings are between 0 and 1."""
    for name in names:
        require(settings, name, 0 <= getattr(settings, name) <= 1, "between 0 and 1")


def require_factor(settings: object, *names: str) -> None:
    """Raise `SettingsError` unless the named settings are greater than 0 and at most 1."""
    for name in names:
        require(settings, name, 0 < getattr(settings, name) <= 1, "greater than 0 and at most 1")
