"""Options under the names of an earlier release; no command of its own.

Such an option still works for one release. It is missing in the help, and using it is reported as a `Warned` event.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from ...core.events import Emit, Warned

__all__ = ["add_deprecated_option", "warn_of_deprecated_options"]

_MESSAGES = "deprecation_messages"


def add_deprecated_option(
    parser: argparse._ActionsContainer, old: str, *, replaced_by: argparse.Action
) -> argparse.Action:
    """Let a renamed option be given under its old name as well.

    Parameters
    ----------
    parser : argparse.ArgumentParser or a group of its arguments
    old : str
        The old option, such as ``"--passers-by"``.
    replaced_by : argparse.Action
        What `add_argument` returned for the new option. The value given under the old name is stored as its value.
    """
    return parser.add_argument(
        old,
        action=_DeprecatedOption,
        replaced_by=replaced_by,
        dest=f"deprecated_{old.strip('-').replace('-', '_')}",
        default=argparse.SUPPRESS,
        help=argparse.SUPPRESS,
    )


def warn_of_deprecated_options(options: argparse.Namespace, emit: Emit) -> None:
    """Emit one `Warned` for each option that was given under its old name."""
    for message in getattr(options, _MESSAGES, ()):
        emit(Warned(message))


class _DeprecatedOption(argparse.Action):
    """Does what the option does that replaces it, and keeps a message for `warn_of_deprecated_options`."""

    def __init__(
        self, option_strings: Sequence[str], dest: str, *, replaced_by: argparse.Action, **others: Any
    ) -> None:
        copied = {name: getattr(replaced_by, name) for name in ("nargs", "type", "choices", "metavar")}
        super().__init__(option_strings, dest, **{**copied, **others})
        self._replaced_by = replaced_by

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        new = self._replaced_by.option_strings[0]
        self._replaced_by(parser, namespace, values, new)
        message = f"{self.option_strings[0]} is deprecated and will be removed in the next release. Use {new} instead."
        setattr(namespace, _MESSAGES, [*getattr(namespace, _MESSAGES, []), message])
