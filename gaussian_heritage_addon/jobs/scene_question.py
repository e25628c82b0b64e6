"""Words asked of the scene that the running job trains: an engine of its own answers, beside the job.

There is one question at a time, for all scenes and windows. It belongs to no .blend file: undoing and loading another
file leave it as it is. It ends with Blender, as nobody could see its answer.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from pathlib import Path

from ...engine.core.errors import HeritageError, ProjectError
from ...engine.core.files import delete_derived
from ...engine.project.scene_questions import Answers, question_arguments, read_answers
from ...engine.workers.jobs import Job
from ..blender import problems
from ..blender.guards import Timer, on_unregister, redraw
from ..setup.engine_process import engine_command
from ..setup.preferences import current_environment, current_python, sam_arguments, user_folder
from . import job_runner

_KIND = "ask"
_STAGE = "training"
"""Stage of a job in which there is a scene to ask."""
_INTERVAL = 0.5
"""Seconds between two polls."""
_PICTURES = "pictures "
"""Begin of the name of the folder with the pictures of an answer. Each has its own: another Blender may show it."""


@dataclass
class Question:
    """A question and what became of it.

    Attributes
    ----------
    job : Job
        The engine that answers.
    answers : Answers or None
        None while the engine looks, and where it found nothing.
    problem : str
        Why there is no answer, as a sentence: nothing was found, or something is wrong.
    """

    job: Job
    answers: Answers | None = None
    problem: str = ""

    @property
    def words(self) -> str:
        """What is asked."""
        return _option(self.job, "prompt")

    @property
    def project(self) -> Path:
        """The project of the scene that is asked."""
        return Path(self.job.subject)

    @property
    def is_over(self) -> bool:
        """Whether there is an answer, or a reason why there is none."""
        return self.answers is not None or bool(self.problem)


_question: Question | None = None


def shown() -> Question | None:
    """Return the last question, until it is dismissed; None where there is none."""
    return _question


def asked_project() -> Path | None:
    """Return the project of the scene that can be asked: one that is being trained. None where there is none."""
    current = job_runner.current()
    if current is None:
        return None
    job, state = current
    return Path(job.subject) if state.running and job.kind == "reconstruct" and state.stage == _STAGE else None


def ask(words: str) -> None:
    """Ask the scene that is being trained; `shown` has the answer later.

    Raises
    ------
    HeritageError
        When no scene is being trained, a question is being answered already, the words name nothing or too much, or
        the engine cannot be started.
    """
    global _question
    project = asked_project()
    if project is None:
        raise ProjectError("No scene is being trained. Words can be asked while one is; afterwards, isolate objects.")
    folder = user_folder("question")
    earlier = Job.attach(folder)
    if earlier is not None and earlier.poll().running:
        if _question is None or _question.is_over:
            # Of another Blender, or of one that crashed: it can be cancelled here.
            _show(earlier)
        raise ProjectError("A question is still being answered. Wait for its answer, or cancel it.")
    out = folder / f"{_PICTURES}{secrets.token_hex(4)}"
    arguments = [*question_arguments(project, words, out), *sam_arguments()]
    command = engine_command(current_python(), *arguments)
    for one in folder.glob(f"{_PICTURES}*"):
        delete_derived(folder, one.name)
    _show(Job.start(command, folder, kind=_KIND, subject=str(project), environment=current_environment()))


def cancel() -> None:
    """Stop looking for an answer.

    Raises
    ------
    HeritageError
        When no question is being answered, or it cannot be stopped.
    """
    if _question is None or _question.is_over:
        raise ProjectError("No question is being answered.")
    _question.job.cancel()


def dismiss() -> None:
    """Do not show the last answer any more; a question that is being answered stays."""
    global _question
    if _question is not None and _question.is_over:
        _question = None


def poll() -> float | None:
    """Take the answer when it is there; return the seconds until the next call."""
    global _question
    if _question is None or _question.is_over:
        return None
    state = _question.job.poll()
    redraw()
    if state.running:
        return _INTERVAL
    if _question.job.was_stopped():
        _question = None
    elif state.error:
        _question.problem = state.error
    else:
        try:
            _question.answers = read_answers(state.outputs, Path(_option(_question.job, "out")))
        except HeritageError as error:
            _question.problem = problems.sentence_of(error)
    return None


def _option(job: Job, name: str) -> str:
    begin = f"--{name}="
    return next((word.removeprefix(begin) for word in job.command if word.startswith(begin)), "")


def _show(job: Job) -> None:
    global _question
    _question = Question(job)
    _timer.start(_INTERVAL, persistent=True)


_timer = Timer(poll)


def stop() -> None:
    """Stop looking, and forget the question."""
    global _question
    _timer.stop()
    if _question is not None and _question.job.poll().running:
        _question.job.cancel()
    _question = None


def register() -> None:
    """End the question once the add-on is gone."""
    on_unregister(stop)
