"""What a scene is trained on, and the sizes of its preset there.

The sizes are recorded in the project when training begins and kept then, also on another computer: a scene that a card
trained stays done where there is no card, and an interrupted training continues there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...core.errors import EnvironmentProblem, SettingsError
from ...core.files import check
from ...project.folder import ProjectFolder
from ...rasterizer import Device
from ...scene import PhotoSet
from ...training import preset_on_card, settings_with_sizes, sizes_on_card
from ...training.settings import PRESETS, TrainingSettings
from .card_forecast import card_bytes, gaussians_that_fit
from .decisions import PlanSettings, largest_photo, n_test_photos

_RECORD = "training_sizes"
"""Name in ``project.json`` of the sizes of each preset that was trained."""
_SIZES = dict.fromkeys(("steps", "rounds", "max_side", "max_gaussians"), int)
_DEVICE = {
    "backend": str,
    "name": str,
    "reason": str,
    "memory": (int, None),
    "shares_memory": bool,
    "n_bytes": int,
    "limited": bool,
    "kept": bool,
}
_UNBOUNDED = 1 << 62


def choose_sizes(
    settings: PlanSettings,
    photo_set: PhotoSet,
    device: Device,
    kept: Mapping[str, int] | None,
    *,
    free: int | None,
) -> tuple[Device, dict[str, int]]:
    """Return the planned device, the processor if the card does not hold the scene, and the preset's sizes there.

    Parameters
    ----------
    device : Device
        One that is planned already stays as it is.
    kept : mapping or None
        Sizes that the project was begun with, see `kept_sizes`; None for a new one.
    free : int or None
        Bytes of the computer's free memory.

    Raises
    ------
    EnvironmentProblem
        If ``gpu`` is wanted and the card does not hold the scene.
    SettingsError
        If sizes are wanted that the device or the preset cannot have, or that the project was not begun with.
    """
    wanted = settings.wanted_sizes
    if device.planned:
        _require_kept(wanted, kept or {})
        return device, dict(kept or {})
    if device.backend == "cpu":
        if wanted and kept is None:
            reason = f": {device.reason}" if device.reason else ""
            raise SettingsError(f"{_options(wanted)} needs training on a graphics card, and none is used{reason}.")
        _require_kept(wanted, kept or {})
        return Device(reason=device.reason, planned=True, kept=bool(kept)), dict(kept or {})
    preset = settings.preset
    n_photos = len(photo_set.photos)
    n_training = n_photos - n_test_photos(n_photos, settings)
    largest = largest_photo(photo_set)
    features = settings.wants_objects or not settings.leave_out

    def on_card(sizes: Mapping[str, int]) -> tuple[TrainingSettings, dict[str, Any]]:
        training = settings_with_sizes(preset, sizes, n_training).changed(**settings.overrides)
        scale = min(1.0, training.schedule.max_side / max(largest.width, largest.height))
        width, height = round(largest.width * scale), round(largest.height * scale)
        values = {"sh_degree": training.appearance.sh_degree, "width": width, "height": height}
        return training, {**values, "features": features, "n_photos": n_photos}

    unbounded = sizes_on_card(preset, _UNBOUNDED, wanted, n_training=n_training)
    if wanted and not unbounded:
        raise SettingsError(f"{_options(wanted)} cannot be used with the preset {preset}, whose sizes are fixed.")
    _, scene = on_card(unbounded if kept is None else kept)
    room = gaussians_that_fit(
        own_memory=device.memory,
        free=free if device.shares_memory else None,
        max_buffer_bytes=device.max_buffer_bytes,
        **scene,
    )
    chosen = sizes_on_card(preset, room, wanted, n_training=n_training)
    sizes = chosen if kept is None else kept
    if dict(sizes) != chosen:
        _require_kept(wanted, sizes)
    own = PRESETS[preset_on_card(preset, n_training)]
    smallest = own.changed(**settings.overrides) if kept is None else on_card(kept)[0]
    needed = smallest.growth.max_gaussians
    if room < needed:
        reason = (
            f"{device.name} holds {room:,} Gaussians beside {n_photos} photos of {scene['width']} x {scene['height']} "
            f"pixels and this scene needs {needed:,}"
        )
        if settings.device == "gpu":
            raise EnvironmentProblem(f"{reason}; use a smaller preset or fewer photos, or use --device cpu.")
        return Device(reason=reason, planned=True, kept=bool(kept)), dict(kept or {})
    training, scene = on_card(sizes)
    planned = Device(
        "gpu",
        device.name,
        planned=True,
        memory=device.memory,
        shares_memory=device.shares_memory,
        n_bytes=card_bytes(training.growth.max_gaussians, **scene),
        limited=kept is None and bool(chosen) and chosen["max_gaussians"] < unbounded["max_gaussians"],
        kept=kept is not None and dict(kept) != chosen,
    )
    return planned, dict(sizes)


def _require_kept(wanted: Mapping[str, int], kept: Mapping[str, int]) -> None:
    """Raise an error if a project was begun with other sizes than are wanted."""
    other = {name: value for name, value in wanted.items() if kept.get(name) != value}
    if other:
        raise SettingsError(
            f"The training of this project was begun without {_options(other)} and keeps its sizes. Leave that out to "
            "go on with them, or use a new folder."
        )


def _options(sizes: Mapping[str, int]) -> str:
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in sizes.items())


def training_is_to_come(project: ProjectFolder, preset: str, *, photos_changed: bool) -> bool:
    """Return whether the project has no training of this preset and of these photos yet."""
    record = project.stage_record("training")
    return photos_changed or record is None or record["figures"].get("preset") != preset


def kept_sizes(project: ProjectFolder, preset: str) -> dict[str, int] | None:
    """Return the sizes that this preset was begun with in the project, None where it was not begun."""
    stored = project.get(_RECORD)
    if isinstance(stored, dict) and preset in stored:
        sizes = stored[preset]
        if sizes == {} or check(sizes, _SIZES) is None:
            return {name: sizes[name] for name in _SIZES if name in sizes}
    return None


def record_sizes(project: ProjectFolder, preset: str, sizes: Mapping[str, int]) -> None:
    """Record the sizes of a preset, when its training begins."""
    stored = project.get(_RECORD)
    recorded = {**(stored if isinstance(stored, dict) else {}), preset: dict(sizes)}
    if recorded != stored:
        project.put(_RECORD, recorded)


def planned_device(project: ProjectFolder, preset: str) -> Device:
    """Return the device of the project's last plan, the processor where that is not known or was for another preset."""
    plan = project.get("work_plan")
    stored = plan.get("device") if isinstance(plan, dict) and plan.get("preset") == preset else None
    if isinstance(stored, dict) and check(stored, _DEVICE) is None and stored["backend"] in ("cpu", "gpu"):
        return Device(planned=True, **{name: stored[name] for name in _DEVICE})
    return Device(planned=True)
