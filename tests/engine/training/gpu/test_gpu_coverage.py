"""How many photos see what a picture shows, by depth maps from a card."""

from __future__ import annotations

from engine.training.coverage import Coverage

from ..test_coverage import camera_at, values_of, wall


def test_a_card_counts_the_photos_that_the_processor_counts() -> None:
    values = values_of(wall((-8, 8), 4.0).joined(wall((-0.3, 0.3), 2.0)))
    cameras = [camera_at(x) for x in (-2.0, 0.0, 2.0)]
    counts = [Coverage(values, cameras, backend=backend).counts(camera_at(1.0)) for backend in ("cpu", "gpu")]
    assert set(counts[0].ravel()) >= {1, 2}
    # Pixels at the edge of the board and of what a photo shows may be rounded to either side.
    assert (counts[0] == counts[1]).mean() > 0.99
