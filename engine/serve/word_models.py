"""The model that knows more words: what the page tells of it, and who may have it fetched to the server."""

from __future__ import annotations

from typing import Any

from ..core.errors import ModelFileError
from ..install.models import find_model_files, models_folder
from .settings import ServeSettings

_REFUSAL = (
    "The owner of this server fetches the model that knows any word: python -m engine models fetch {}. Then ask again."
)


def describe_offer(name: str, settings: ServeSettings) -> dict[str, Any] | None:
    """Return what the page tells of an offered model; None for none.

    ``stored`` says that it need not be fetched any more, and ``refusal`` why the user cannot have it fetched.
    """
    try:
        files = find_model_files(name)
    except ModelFileError:
        return None
    # The engine verifies them when it loads them.
    stored = all((models_folder() / file.file).exists() for file in files)
    return {
        "model": name,
        "bytes": sum(file.about_bytes for file in files),
        "licence": files[0].licence,
        "users": files[0].who_may_use,
        "stored": stored,
        "refusal": "" if stored or settings.users_may_fetch else _REFUSAL.format(name),
    }
