"""Cards that passed their self-test in another process of the same run: they are not tested again in this one."""

from __future__ import annotations

_PASSED: set[str] = set()


def passed_elsewhere(card: str) -> None:
    """Take a card, by its name with its interface as in `Device.name`, for tested in this process."""
    _PASSED.add(card)


def has_passed_elsewhere(card: str) -> bool:
    """Return whether a card, by the same name, was tested."""
    return card in _PASSED
