"""``segment``: isolates objects of a trained scene by text, click, box or mask, corrects them, or finds all of them."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import PromptError, SettingsError
from ...core.events import Emit, Finished, StopCheck, Warned
from ...core.words import split_texts
from ...objects import parse_point, parse_prompt
from ...objects.settings import DEFAULT_PRESET, PRESETS
from ...project.folder import ProjectFolder
from ...project.objects import object_ids
from ...project.own_words import learns_words
from ...project.refused_prompts import read_not_found
from ...rasterizer import PROCESSOR, choose_device
from .chosen_models import add_sam_argument, model_factories
from .named_photos import known_photo, points_in_known_photos, prompt_in_known_photos
from .scene_options import add_device_option, add_own_words_option, own_words_of

if TYPE_CHECKING:
    from ...objects import Segmenter
    from ...scene import Camera, PinholeCamera

NAME = "segment"
HELP = "Isolate objects of a trained scene by text, click, box or mask; correct an object; or find all objects."
EXAMPLE = "python -m engine segment scene --click IMG_3023.jpg=364,500 --not IMG_3023.jpg=364,700 --name statue"
LOG_IN = "project"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    action = parser.add_argument_group(
        "action", "Give exactly one of these options. --refine may be combined with --click."
    )
    action.add_argument("--prompt", metavar="TEXT", help='name of the object in English words; several: "vase, teapot"')
    action.add_argument(
        "--click", action="append", default=[], metavar="PHOTO=x,y",
        help="a pixel of the object, from the photo's top left corner; several, in any photos, mean one object",
    )  # fmt: skip
    action.add_argument("--box", metavar="PHOTO=x0,y0,x1,y1", help="a box around the object, in pixels of a photo")
    action.add_argument(
        "--mask", metavar="PHOTO=MASK.png", help="a mask of the photo's size, white where the object is"
    )
    action.add_argument("--all", action="store_true", help="every object of the scene, and the background")
    action.add_argument("--complement", action="store_true", help="the background: all that belongs to no object yet")
    action.add_argument(
        "--accept", type=int, metavar="N", help="candidate N of objects/candidates.json, stored for a refused text"
    )
    action.add_argument(
        "--meant", type=int, nargs="?", const=1, metavar="N",
        help="ask again for what the refused texts were probably meant for: suggestion N of each (default: the first)",
    )  # fmt: skip
    action.add_argument(
        "--refine", metavar="OBJECT", help="correct this object: --click adds, --not removes, --level selects a level"
    )
    action.add_argument(
        "--detail", nargs="*", metavar="OBJECT",
        help="train these objects, or all, on the photos at their own resolution; the scene stays as it is",
    )  # fmt: skip
    parser.add_argument(
        "--not", dest="excluded", action="append", default=[], metavar="PHOTO=x,y",
        help="a pixel that does not belong to the object; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--level", type=int, metavar="K", help="level of the object with --refine; 0 is the smallest part"
    )
    parser.add_argument(
        "--seen-from", metavar="VIEW",
        help="where left and right of a text are seen from: the name of a photo, or a camera as of `render --camera`, "
        "its file or its JSON (default: the photo that shows most)",
    )  # fmt: skip
    parser.add_argument(
        "--fetch", metavar="MODEL",
        help="first fetch a model that knows more words, see `models list`; the text is asked then",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="offline", type=Path, metavar="FOLDER",
        help="copy the files of --fetch from FOLDER instead of using the network",
    )  # fmt: skip
    parser.add_argument("--name", help="name of the object (default: the text, or 'object')")
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default=DEFAULT_PRESET, help="preset of the method (default: %(default)s)"
    )
    add_sam_argument(parser)
    add_device_option(parser, "render views and count votes")
    add_own_words_option(parser)


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the action of the options and store its result in the project."""
    action = _action(options)
    with ProjectFolder.open_existing(options.project) as project:
        message, outputs = _ACTIONS[action](project, options, emit, should_stop)
    emit(Finished(message, outputs))
    return 0


def _action(options: argparse.Namespace) -> str:
    """Return the one action that the options name."""
    given = {
        "prompt": options.prompt is not None,
        "pointed": bool(options.click) or options.box is not None or options.mask is not None,
        "all": options.all,
        "complement": options.complement,
        "accept": options.accept is not None,
        "meant": options.meant is not None,
        "refine": options.refine is not None,
        "detail": options.detail is not None,
    }
    if given["refine"] and options.box is None and options.mask is None:
        given["pointed"] = False
    actions = [name for name, is_given in given.items() if is_given]
    if len(actions) != 1:
        raise SettingsError(
            "Give exactly one of --prompt, --click, --box, --mask, --all, --complement, --accept, --meant, --refine "
            "and --detail."
        )
    action = actions[0]
    if options.excluded and action not in ("pointed", "refine"):
        raise SettingsError("--not requires --click, --box, --mask or --refine.")
    if options.level is not None and action != "refine":
        raise SettingsError("--level requires --refine.")
    if options.seen_from is not None and action not in ("prompt", "meant"):
        raise SettingsError("--seen-from requires --prompt, or --meant.")
    if options.fetch is not None and action != "prompt":
        raise SettingsError("--fetch requires --prompt.")
    if options.offline is not None and options.fetch is None:
        raise SettingsError("--from requires --fetch.")
    if options.name is not None and action in ("all", "complement", "refine", "detail", "meant"):
        raise SettingsError(f"--name cannot be combined with --{action}.")
    return action


def _segmenter(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck, *, renders: bool = True
) -> Segmenter:
    """Return what carries out the action; without `renders`, no device is looked for."""
    from ...objects import Segmenter

    return Segmenter(
        project, PRESETS[options.preset], **model_factories(options), emit=emit, should_stop=should_stop,
        device=choose_device(options.device) if renders else PROCESSOR,
        own_words=own_words_of(options) if learns_words(project) else None,
    )  # fmt: skip


def _texts(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    texts = split_texts(options.prompt)
    if not texts:
        raise PromptError("The prompt is empty. Type what the object is, for example: vase.")
    if options.name is not None and len(texts) > 1:
        raise SettingsError(
            f"--name cannot be combined with several texts: {', '.join(map(repr, texts))}. Without it, each object is "
            "named after its text. A text in quotation marks is one."
        )
    return _ask(project, texts, options, emit, should_stop)


def _ask(
    project: ProjectFolder, texts: list[str], options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    from ...objects import CANDIDATES

    camera = None if options.seen_from is None else _camera(project.path, options.seen_from)
    if options.fetch is not None:
        _fetch(options, emit, should_stop)
    segmenter, before = _segmenter(project, options, emit, should_stop), object_ids(project.path)
    try:
        records, refused = segmenter.segment_texts(texts, options.name, camera)
    except PromptError as error:
        raise PromptError(f"{error} {_what_now(project.path)}".strip()) from error
    message, outputs = _stored(records, before, segmenter)
    if refused:
        outputs["refused"] = refused
        outputs["candidates"] = CANDIDATES
    return message, outputs


def _what_now(project: Path) -> str:
    """Return which options answer what was refused; empty for none."""
    not_found = read_not_found(project)
    if not_found is None:
        return ""
    meant = [repr(one.suggestions[0]) for one in not_found.refusals if one.suggestions]
    said = [f"With --meant in place of --prompt, {' and '.join(meant)} is asked for."] if meant else []
    if not_found.candidates:
        first = not_found.candidates[0]
        said.append(f"Is it one of the pictures in {first.picture.parent}? --accept N takes number N.")
    return " ".join(said)


def _meant(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    not_found = read_not_found(project.path)
    refusals = () if not_found is None else not_found.refusals
    number = options.meant
    texts = [one.suggestions[number - 1] for one in refusals if 1 <= number <= len(one.suggestions)]
    if not texts:
        raise PromptError(f"No text was refused for which suggestion {number} is known. Ask for a text first.")
    return _ask(project, list(dict.fromkeys(texts)), options, emit, should_stop)


def _fetch(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> None:
    """Fetch the model of --fetch."""
    from ...install.models import fetch_model
    from ...objects.grounding import WORD_MODELS

    if options.fetch not in WORD_MODELS:
        raise SettingsError(f"{options.fetch} is not a model for words. Known: {', '.join(WORD_MODELS)}.")
    fetch_model(options.fetch, emit=emit, should_stop=should_stop, offline=options.offline)


def _camera(project: Path, view: str) -> Camera | PinholeCamera:
    """Return the camera that --seen-from means."""
    from ...cameras import parse_camera_json, read_camera_json
    from ...scene import read_camera_set

    if view.lstrip().startswith("{"):
        return parse_camera_json(view)
    cameras = read_camera_set(project / "cameras").by_photo
    # A file that exists is meant as a file, unless a photo has just this name.
    photo = view if Path(view).is_file() else known_photo(view, cameras)
    return cameras[photo] if photo in cameras else read_camera_json(Path(view))


def _pointed(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    prompt = parse_prompt(click=options.click, box=options.box, mask=options.mask, excluded=options.excluded)
    project.require_intact("cameras")
    prompt = prompt_in_known_photos(prompt, project.path)
    segmenter, before = _segmenter(project, options, emit, should_stop), object_ids(project.path)
    records = segmenter.segment(prompt, "object" if options.name is None else options.name)
    return _stored(records, before, segmenter)


def _accept(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    # What is accepted was rendered when it was offered.
    segmenter, before = _segmenter(project, options, emit, should_stop, renders=False), object_ids(project.path)
    records = segmenter.accept_candidate(options.accept, options.name)
    return _stored(records, before, segmenter)


def _refine(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    clicks = [parse_point(text) for text in options.click]
    excluded = [parse_point(text) for text in options.excluded]
    if options.level is not None and (clicks or excluded):
        raise SettingsError("--level cannot be combined with clicks: they change the object and delete its levels.")
    if options.level is None and not (clicks or excluded):
        raise SettingsError("--refine requires --click to add something, --not to remove something, or --level.")
    segmenter = _segmenter(project, options, emit, should_stop)
    if options.level is not None:
        record = segmenter.choose_level(options.refine, options.level)
    else:
        added, removed = (points_in_known_photos(points, project.path) for points in (clicks, excluded))
        record = segmenter.refine(options.refine, added, removed)
    return f"{record.name} has {record.n_gaussians:,} Gaussians now.", _outputs([record], segmenter)


def _detail(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    segmenter = _segmenter(project, options, emit, should_stop)
    records = segmenter.detail(options.detail)
    gained = [one.name for one in records if one.detail is not None and one.detail["kept"]]
    message = f"Detail from the photos: {', '.join(gained) or 'no object gained by it'}."
    for one in records:
        if one.detail is not None and not one.detail["kept"]:
            emit(Warned(f"{one.name!r} stays as it is in the scene: {one.detail['why']}."))
    return message, {**_outputs(records, segmenter), "detail": {one.id: one.detail for one in records}}


def _complement(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    record = _segmenter(project, options, emit, should_stop, renders=False).store_background()
    return f"The background has {record.n_gaussians:,} Gaussians.", {"objects": [record.id], "background": record.id}


def _all(
    project: ProjectFolder, options: argparse.Namespace, emit: Emit, should_stop: StopCheck
) -> tuple[str, dict[str, Any]]:
    segmenter = _segmenter(project, options, emit, should_stop)
    created, kept, background = segmenter.segment_everything()
    message = f"{_isolated(created)} {len(kept)} existing objects were kept." if kept else _isolated(created)
    outputs = _outputs([*created, background], segmenter)
    return message, {**outputs, "background": background.id, "kept": kept}


_ACTIONS = {
    "prompt": _texts,
    "pointed": _pointed,
    "all": _all,
    "complement": _complement,
    "accept": _accept,
    "meant": _meant,
    "refine": _refine,
    "detail": _detail,
}


def _stored(records: list[Any], before: Collection[str], segmenter: Segmenter) -> tuple[str, dict[str, Any]]:
    """Return the message and the outputs for records of objects, of which those in `before` were found again."""
    new = [record for record in records if record.id not in before]
    existing = list(dict.fromkeys(record.id for record in records if record.id in before))
    message, outputs = _isolated(new), _outputs(records, segmenter)
    if not existing:
        return message, outputs
    names = ", ".join(dict.fromkeys(record.name for record in records if record.id in before))
    found = f"Found again: {names}, so nothing was stored twice."
    return (f"{message} {found}" if new else found), {**outputs, "existing": existing}


def _outputs(records: list[Any], segmenter: Segmenter) -> dict[str, Any]:
    return {"objects": [record.id for record in records], "device": segmenter.device.name}


def _isolated(records: list[Any]) -> str:
    # Only a word may mean something else than what was found: what was clicked is what it is.
    names = ", ".join(
        f"{record.name} ({record.score:.2f})" if record.prompt.get("kind") == "text" else record.name
        for record in records
    )
    return f"Isolated {names}." if names else "No further object was found."
