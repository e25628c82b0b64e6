"""What a unit of length of a project is: metres where a distance was given, otherwise not known."""

from __future__ import annotations

from typing import Any

from ..project_folder import ProjectFolder

__all__ = ["describe_unit"]

_NOT_KNOWN = "The unit of length is not known, because no distance was given. It is not a metre."


def describe_unit(project: ProjectFolder) -> dict[str, Any]:
    """Return what is known of the unit of length.

    Returns
    -------
    dict
        ``known``; ``metres_per_unit``, None where it is not known; ``text``, a sentence for people.
    """
    return {"known": False, "metres_per_unit": None, "text": _NOT_KNOWN}
