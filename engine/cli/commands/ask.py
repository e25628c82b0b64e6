"""``ask``: looks for what words name in a scene that is still being trained; nothing is stored in the project."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import PromptError, SettingsError
from ...core.events import Emit, Finished, StopCheck, Warned
from ...core.words import split_texts
from ...objects.settings import BETTER
from ...pipeline.asking import ask_preview
from ...project.folder import ProjectFolder
from ...project.own_words import learns_words
from .chosen_models import add_sam_argument, model_factories
from .scene_options import add_own_words_option, own_words_of

NAME = "ask"
HELP = "Look for what words name in a scene that is still being trained; nothing is stored in the project."
EXAMPLE = 'python -m engine ask scene --prompt "vase, teapot" --out answers'
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder in which `reconstruct` works")
    parser.add_argument("--prompt", required=True, metavar="TEXT", help='English words; several: "vase, teapot"')
    parser.add_argument("--out", type=Path, required=True, help="folder for a picture of each thing that is found")
    add_sam_argument(parser)
    add_own_words_option(parser)


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Answer, with a picture of each thing."""
    texts = split_texts(options.prompt)
    if not texts:
        raise SettingsError(f'--prompt {options.prompt!r} names nothing. Write for example: --prompt "vase, teapot".')
    project = ProjectFolder.open_existing(options.project)
    answers = ask_preview(
        project, texts, options.out, BETTER, **model_factories(options),
        own_words=own_words_of(options) if learns_words(project) else None, emit=emit, should_stop=should_stop,
    )  # fmt: skip
    if not answers.found:
        raise PromptError(" ".join(answers.refused.values()))
    for reason in answers.refused.values():
        emit(Warned(reason))
    named = "; ".join(f"{one.text} in {one.photo} ({one.picture})" for one in answers.found)
    message = f"After step {answers.step} of the training, the scene shows: {named}."
    emit(Finished(message, answers.outputs()))
    return 0
