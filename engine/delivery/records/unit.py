"""The unit of length of a project: metres where a distance was given, otherwise not known."""

from __future__ import annotations

from typing import Any

from ...project.folder import ProjectFolder
from ...scene import load_measurement

_NOT_KNOWN_SENTENCE = "The unit of length is not known, because no distance was given. It is not a metre."


def describe_unit(project: ProjectFolder) -> dict[str, Any]:
    """Return what is known of the unit of length of a project's world, the frame of ``cameras/``.

    Returns
    -------
    dict
        ``known``; ``metres_per_unit``, None where it is not known; ``text``, a sentence about files for people;
        ``residual_metres``, by which several distances contradict each other (RMS).

    Raises
    ------
    FormatError
        When the measurement of the project is damaged.
    """
    measurement = load_measurement(project.path)
    if measurement.metres_per_unit is None:
        return {"known": False, "metres_per_unit": None, "text": _NOT_KNOWN_SENTENCE}
    count = len(measurement.distances)
    unit: dict[str, Any] = {
        "known": True,
        "metres_per_unit": measurement.metres_per_unit,
        "text": f"Files are in metres, from {count} distance{'' if count == 1 else 's'} measured in the photos.",
    }
    if measurement.scale_residual is not None:
        unit["residual_metres"] = measurement.scale_residual
        unit["text"] += f" The distances contradict each other by {1000 * measurement.scale_residual:.1f} mm (RMS)."
    return unit
