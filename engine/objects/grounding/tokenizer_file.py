"""Opening the tokenizer of a language model, a ``tokenizer.json``; the only module that imports tokenizers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import EnvironmentProblem, ModelFileError

if TYPE_CHECKING:
    from tokenizers import Tokenizer


def open_tokenizer(path: Path, model: str) -> Tokenizer:
    """Return the tokenizer in a file. It neither cuts texts off nor pads them.

    Parameters
    ----------
    model : str
        What the catalogue calls the model or the file, for the message.

    Raises
    ------
    ModelFileError
        When the file is missing or damaged.
    EnvironmentProblem
        When the package ``tokenizers`` is missing.
    """
    try:
        from tokenizers import Tokenizer
    except ImportError as error:
        raise EnvironmentProblem(
            "The package tokenizers is not installed in the engine's environment. Set up the engine again."
        ) from error
    try:
        tokenizer = Tokenizer.from_file(str(path))
    except Exception as error:  # tokenizers raises plain Exception
        raise ModelFileError(
            f"The tokenizer file {path} cannot be read ({error}). Delete it and its record, then run: "
            f"python -m engine models fetch {model}"
        ) from error
    tokenizer.no_truncation()
    tokenizer.no_padding()
    return tokenizer
