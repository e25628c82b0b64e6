"""Photos of a room to a trained project: the preset ``standard`` as a user gets it, from the true cameras."""

from __future__ import annotations

from pathlib import Path

from engine.cameras import has_points
from engine.core.events import Emit, StopCheck
from engine.pipeline.planning import plan_work, training_settings
from engine.pipeline.reconstruct import PipelineSettings
from engine.quality.bench.prepared import prepare, prepare_masks, train_prepared


def reconstruct_room(room: Path, out: Path, *, emit: Emit, should_stop: StopCheck) -> None:
    """Reconstruct a room with the method of this working tree; a killed run is continued.

    Parameters
    ----------
    room : Path
        Folder with ``photos`` and ``cameras``.
    out : Path
        Project folder.
    emit, should_stop
        See `engine.core.events`.

    Raises
    ------
    HeritageError
        As `engine.pipeline.reconstruct.reconstruct`.
    """
    settings = PipelineSettings(given_cameras=room / "cameras")
    assert settings.given_cameras is not None
    prepared = prepare(room / "photos", out, settings, emit=emit, should_stop=should_stop)
    work = plan_work(
        prepared.photo_set,
        prepared.statistics,
        settings.plan,
        cameras=settings.cameras,
        poses_given=True,
        points_given=has_points(settings.given_cameras),
    )
    prepared, _ = prepare_masks(prepared, out, work, settings, emit=emit, should_stop=should_stop)
    train_prepared(prepared, out, work, training_settings(work), emit=emit, should_stop=should_stop)
