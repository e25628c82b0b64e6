"""Which training photos decisions of a run are made on. Standard library only: settings and plans read it."""

from __future__ import annotations

MIN_PHOTOS_TO_CHOOSE = 24
"""Least number of training photos of which some are validation photos. With fewer, nothing is chosen during a run, see
`TrainingSettings.for_photos`."""
_VALIDATION_EVERY = 8  # chosen on museum_room
"""One of so many training photos is a validation photo."""
_MAX_VALIDATION_PHOTOS = 8
"""Largest number of validation photos, all of which are measured at each decision."""


def validation_photos(n_training: int) -> tuple[int, ...]:
    """Return the validation photos among `n_training` training photos, as numbers in their order, evenly spaced.

    Trials are decided on them. They are not trained on until the last trial is made, see `Schedule.validation_until`.
    Below `MIN_PHOTOS_TO_CHOOSE` training photos there are none.
    """
    if n_training < MIN_PHOTOS_TO_CHOOSE:
        return ()
    count = min(_MAX_VALIDATION_PHOTOS, n_training // _VALIDATION_EVERY)
    return tuple((2 * i + 1) * n_training // (2 * count) for i in range(count))
