"""``segment``: isolate objects of a trained scene by text, click, box or a given mask, correct them, or find all."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import SettingsError
from ..events import Emit, Finished, StopCheck
from ..objects import parse_point, parse_prompt, parse_texts
from ..objects.settings import DEFAULT_PRESET, PRESETS
from ..project_folder import ProjectFolder
from .chosen_models import add_sam_argument, models_of

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "segment"
HELP = "Isolate objects of a scene by text, click, box or a given mask image; correct one; or find all."
EXAMPLE = "python -m engine segment scene --click IMG_3023.jpg=364,500 --not IMG_3023.jpg=364,700 --name statue"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    what = parser.add_argument_group("what; exactly one, and --refine may go with --click")
    what.add_argument("--prompt", metavar="TEXT", help='what it is, in words; several: "vase;teapot"')
    what.add_argument(
        "--click", action="append", default=[], metavar="PHOTO=x,y",
        help="a pixel of a photo, from its top left corner; several, in any photos, mean one object",
    )  # fmt: skip
    what.add_argument("--box", metavar="PHOTO=x0,y0,x1,y1", help="a box in a photo, in pixels")
    what.add_argument(
        "--seed-mask", metavar="PHOTO=MASK.png", help="a mask of the photo's size, white where the object is"
    )
    what.add_argument("--all", action="store_true", help="every object of the scene, and the background")
    what.add_argument("--complement", action="store_true", help="the background: what belongs to no object so far")
    what.add_argument(
        "--accept", type=int, metavar="N", help="candidate N of objects/candidates.json, left by a refused text"
    )
    what.add_argument(
        "--refine", metavar="OBJECT", help="correct this object: --click adds, --not takes away, --level part or whole"
    )
    parser.add_argument(
        "--not", dest="excluded", action="append", default=[], metavar="PHOTO=x,y",
        help="a pixel of what does not belong to the object; may be repeated",
    )  # fmt: skip
    parser.add_argument("--level", type=int, metavar="K", help="with --refine: 0 is the smallest part")
    parser.add_argument("--name", help="name of the object (default: the text, or 'object')")
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default=DEFAULT_PRESET, help="method (default: %(default)s)"
    )
    add_sam_argument(parser)


def project_folder(options: argparse.Namespace) -> Path:
    """Return where the log goes."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Isolate, correct or accept, and store the result in the project."""
    what = _what(options)
    with ProjectFolder.open_existing(options.project) as project:
        message, outputs = _DO[what](project, options, emit, should_stop)
    emit(Finished(message, outputs))
    return 0


def _what(options: argparse.Namespace) -> str:
    """Return the one thing that is asked for."""
    given = {
        "prompt": options.prompt is not None,
        "pointed": bool(options.click) or options.box is not None or options.seed_mask is not None,
        "all": options.all,
        "complement": options.complement,
        "accept": options.accept is not None,
        "refine": options.refine is not None,
    }
    if given["refine"] and options.box is None and options.seed_mask is None:
        given["pointed"] = False
    wanted = [name for name, there in given.items() if there]
    if len(wanted) != 1:
        raise SettingsError(
            "Say exactly one thing: --prompt, --click, --box, --seed-mask, --all, --complement, --accept or --refine."
        )
    what = wanted[0]
    if options.excluded and what not in ("pointed", "refine"):
        raise SettingsError("--not goes with --click, --box, --seed-mask or --refine.")
    if options.level is not None and what != "refine":
        raise SettingsError("--level goes with --refine.")
    if options.name is not None and what in ("all", "complement", "refine"):
        raise SettingsError(f"--name does not go with --{what}.")
    return what


def _texts(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import CANDIDATES, segment_texts

    texts = parse_texts(options.prompt)
    if options.name is not None and len(texts) > 1:
        raise SettingsError("One name does not fit several texts. Leave --name out: each is named after its text.")
    records, refused = segment_texts(
        project, texts, options.name, PRESETS[options.preset],
        **models_of(options), emit=emit, should_stop=should_stop,
    )  # fmt: skip
    outputs: dict[str, Any] = {"objects": [record.id for record in records]}
    if refused:
        outputs["refused"] = refused
        outputs["candidates"] = CANDIDATES
    return _isolated(records), outputs


def _pointed(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import segment_project

    prompt = parse_prompt(click=options.click, box=options.box, seed_mask=options.seed_mask, excluded=options.excluded)
    name = "object" if options.name is None else options.name
    records = segment_project(
        project, prompt, name, PRESETS[options.preset], **models_of(options), emit=emit, should_stop=should_stop
    )
    return _isolated(records), {"objects": [record.id for record in records]}


def _accept(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import accept_candidate

    records = accept_candidate(
        project, options.accept, options.name, PRESETS[options.preset],
        **models_of(options), emit=emit, should_stop=should_stop,
    )  # fmt: skip
    return _isolated(records), {"objects": [record.id for record in records]}


def _refine(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import choose_level, refine_object

    clicks = [parse_point(text) for text in options.click]
    excluded = [parse_point(text) for text in options.excluded]
    if options.level is not None and (clicks or excluded):
        raise SettingsError("--level goes without clicks: they change the object, and its levels are then gone.")
    if options.level is not None:
        record = choose_level(
            project, options.refine, options.level, PRESETS[options.preset],
            sam_factory=models_of(options)["sam_factory"], emit=emit, should_stop=should_stop,
        )  # fmt: skip
    elif clicks or excluded:
        record = refine_object(
            project, options.refine, clicks, excluded, PRESETS[options.preset],
            sam_factory=models_of(options)["sam_factory"], emit=emit, should_stop=should_stop,
        )  # fmt: skip
    else:
        raise SettingsError("--refine needs --click for what is missing, --not for what is too much, or --level.")
    return f"{record.name} has {record.n_gaussians:,} Gaussians now.", {"objects": [record.id]}


def _complement(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import store_background

    record = store_background(project, PRESETS[options.preset])
    return f"The background has {record.n_gaussians:,} Gaussians.", {"objects": [record.id], "background": record.id}


def _all(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ..objects import segment_everything_in

    made, kept, background = segment_everything_in(
        project, PRESETS[options.preset], **models_of(options), emit=emit, should_stop=should_stop
    )
    ids = [record.id for record in [*made, background]]
    message = f"{_isolated(made)} {len(kept)} were there before." if kept else _isolated(made)
    return message, {"objects": ids, "background": background.id, "kept": kept}


_DO = {
    "prompt": _texts,
    "pointed": _pointed,
    "all": _all,
    "complement": _complement,
    "accept": _accept,
    "refine": _refine,
}


def _isolated(records: list[Any]) -> str:
    names = ", ".join(f"{record.name} ({record.score:.2f})" for record in records)
    return f"Isolated {names}." if names else "No further object was found."
