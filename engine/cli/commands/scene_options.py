"""Options that several commands share which train or plan a scene; no command of its own."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ...cameras.settings import CameraModel, CameraSettings
from ...core.errors import SettingsError
from ...core.words import split_texts
from ...rasterizer.settings import DeviceName
from ...scene import FISHEYE_LENS
from ...training.settings import LIGHT_DESCRIPTION, LIGHT_SHARE, PRESET_LIST

if TYPE_CHECKING:
    from ...pipeline.planning import PlanSettings
    from ...project.own_words import OwnWords


def describe_presets() -> str:
    """Return the names of the presets with what each is for."""
    return " ".join(f"{preset.name}: {preset.description}" for preset in PRESET_LIST)


def add_preset_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``."""
    from ...pipeline.planning import PlanSettings  # reads photos, which most commands do not

    parser.add_argument(
        "--preset",
        choices=[preset.name for preset in PRESET_LIST],
        default=PlanSettings().preset,
        help=f"how much work. {describe_presets()} (default: %(default)s)",
    )


def add_prompts_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--prompts``; `what` says what they are."""
    parser.add_argument("--prompts", default="", help=f'{what}, in English words, e.g. "vase, teapot"')


def prompts_of(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the texts of ``--prompts``. Raises `SettingsError` if it names none, or ``--no-objects`` is given too."""
    prompts = tuple(split_texts(options.prompts))
    if options.prompts and not prompts:
        raise SettingsError(
            f'--prompts {options.prompts!r} names no object. Write for example: --prompts "vase, teapot".'
        )
    if options.no_objects and prompts:
        raise SettingsError("--no-objects leaves out the features that --prompts needs. Give only one of them.")
    return prompts


def add_device_option(parser: argparse.ArgumentParser, what: str = "train", *, default: str = "auto") -> None:
    """Add ``--device``: what to do `what` on."""
    parser.add_argument(
        "--device",
        choices=get_args(DeviceName),
        default=default,
        help=f"what to {what} on; auto: the graphics card if there is one that passes its self-test (see `doctor`)",
    )


def add_plan_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the work on a folder of photos, most of which `plan_settings_of` reads."""
    add_preset_option(parser)
    add_device_option(parser)
    parser.add_argument(
        "--max-gaussians",
        type=int,
        metavar="N",
        help="largest number of Gaussians on a graphics card, in place of the preset's; fewer if it does not hold them",
    )
    parser.add_argument(
        "--max-side",
        type=int,
        metavar="PIXELS",
        help="longest side of the pictures in training on a graphics card, in place of the preset's 1,600 pixels",
    )
    add_setting_options(parser)
    add_camera_options(parser)
    parser.add_argument(
        "--lens",
        choices=get_args(CameraModel),
        default=CameraSettings().model,
        help="COLMAP's lens model of the photos, where cameras are estimated; the lenses of phones and "
        f"cameras fit the default, action cameras often need {FISHEYE_LENS} (default: %(default)s)",
    )
    add_no_objects_option(parser)


def plan_settings_of(options: argparse.Namespace) -> PlanSettings:
    """Return what `add_plan_options` says of the work; errors as of `overrides_of`."""
    from ...pipeline.planning import PlanSettings

    return PlanSettings(
        preset=options.preset,
        device=options.device,
        max_gaussians=options.max_gaussians,
        max_side=options.max_side,
        wants_objects=not options.no_objects,
        overrides=overrides_of(options),
    )


def add_setting_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--light`` and ``--set``, which `overrides_of` reads."""
    parser.add_argument(
        "--light",
        action="store_true",
        help=LIGHT_DESCRIPTION[:1].lower() + LIGHT_DESCRIPTION[1:],
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one setting of training in place of the preset's, for an experiment, such as lr_means=1e-3; repeatable",
    )


def overrides_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of training that ``--light`` and ``--set`` give; errors as of `read_overrides`."""
    from ...training import read_overrides

    given = read_overrides(options.set)
    if options.light and "kept" in given:
        raise SettingsError("--light and --set both give `kept`. Give only one of them.")
    return {**given, "kept": LIGHT_SHARE} if options.light else given


def add_camera_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--cameras`` and ``--photo-masks``."""
    parser.add_argument(
        "--cameras",
        type=Path,
        help="cameras to use instead of estimating them: a COLMAP model or a project with one, transforms.json, or the "
        "export of Metashape (XML), RealityCapture (CSV, XMP) or Bundler (bundle.out)",
    )
    parser.add_argument(
        "--photo-masks",
        type=Path,
        metavar="FOLDER",
        help="masks named like the photos, as photo.jpg.png or photo.png: pixels that are black in them are ignored",
    )


def add_no_objects_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--no-objects``."""
    parser.add_argument("--no-objects", action="store_true", help="only the scene: no masks, no segmentation features")


def add_own_words_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--own-words``, which `own_words_of` reads."""
    parser.add_argument(
        "--own-words", type=Path, metavar="FILE", help="file of your own vocabulary (default: beside the models)"
    )


def own_words_of(options: argparse.Namespace) -> OwnWords:
    """Return the vocabulary that the options mean."""
    from ...install.models import models_folder
    from ...project.own_words import OwnWords

    return OwnWords(options.own_words or models_folder().parent / "own_words.json")
