"""Isolates the objects of a trained project with several methods and compares them with the true masks."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ...core.arrays import Mask
from ...core.errors import Cancelled, SettingsError
from ...core.events import Emit, Progress, StopCheck, Warned, ignore_events, never_stop
from ...masks import load_default_sam
from ...objects import DetectorFactory, SamFactory
from ...objects.grounding import load_default_detector
from ...objects.settings import BETTER
from ...project.folder import ProjectFolder
from ...rasterizer import PROCESSOR, Device
from ...scene import read_camera_set
from .ceiling import words_of_true_masks
from .comparison import Comparison, Scores, compare_with_all, score_photo
from .gaussian_truth import gaussian_iou, gaussian_truth
from .ground_truth import GroundTruth, read_ground_truth
from .results import FOUND_IOU, Evaluation, Result, ResultKind, Row, Search, Word, mean_of
from .settings import EvaluationSettings, Layout, Method, methods_of
from .trained_scene import Answer, Question, TrainedScene

STAGE = "evaluation"
Answers = Mapping[tuple[Question, str], Answer]
"""Answers by question and name of the method."""

_ISOLATION_SHARE = 0.8
"""Share of the progress bar that isolating takes; comparing takes the rest."""
_EVERYTHING = "all objects"


@dataclass(frozen=True)
class _Task:
    """An object, the question that asks for it, and the photos that it is compared in."""

    object: str
    question: Question
    photos: tuple[str, ...]


@dataclass
class _Returned:
    """The Gaussians that one method returned for one object, bool [N] or None, and their scores in each view."""

    task: _Task
    method: Method
    answer: Answer
    members: Mask | None
    scores: list[Scores]


def evaluate_project(
    project: ProjectFolder,
    truth_folder: Path,
    settings: EvaluationSettings,
    *,
    layout: Layout | Literal["auto"] = "auto",
    detector_factory: DetectorFactory = load_default_detector,
    sam_factory: SamFactory = load_default_sam,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
    device: Device = PROCESSOR,
) -> Evaluation:
    """Isolate every object with every method and compare it with its true masks.

    Parameters
    ----------
    project : ProjectFolder
        Trained; only read.
    layout : str
        See `read_ground_truth`.
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.core.events`.
    device : Device
        What renders the views and counts the votes, see `engine.objects.load_context`.

    Returns
    -------
    Evaluation

    Raises
    ------
    HeritageError
        When a part of the project, or the true masks, are missing or damaged.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    With ``views="held-out"``, isolating an object looks at no photo that the object is compared in: such photos are
    neither rendered, nor read, nor segmented, nor do they vote. Their true masks only tell which objects can be
    compared. An object whose true masks are all in compared photos gives up one of them for its prompt. All objects are
    isolated before the first photo is compared. Predicted masks are those of `render --what mask`.
    """
    cameras = read_camera_set(project.path / "cameras")
    placed = [camera.photo for camera in cameras.cameras]
    truth = read_ground_truth(truth_folder, placed, cameras.unregistered, layout=layout)
    if truth.unplaced:
        emit(Warned(f"{len(truth.unplaced)} views with true masks have no camera here: {', '.join(truth.unplaced)}."))
    held_out = _held_out(project)
    photos = _compared(truth, held_out, settings)
    wanted = _wanted(truth, settings)
    tasks = _tasks(truth, wanted, photos, settings)
    methods = methods_of(settings)
    with tempfile.TemporaryDirectory() as folder:
        hidden = photos if settings.views == "held-out" else ()
        models = (detector_factory, sam_factory)
        scene = TrainedScene(project, cameras, hidden, Path(folder), *models, device=device, emit=emit)
        answers = _ask(scene, _questions(tasks, truth, settings), methods, truth, emit, should_stop)
        whole = scene.new_scene()
        labels = gaussian_truth(whole, cameras, truth, should_stop) if truth.every_pixel else None
        searches: tuple[Search, ...] = ()
        if settings.prompt_kind == "all":
            returned, searches = _match_all(scene, tasks, methods, answers, truth, photos, should_stop)
        else:
            returned = _match(tasks, methods, answers, truth, labels)
        _score(scene, returned, truth, photos, emit, should_stop)
        words: tuple[Word, ...] = ()
        ceiling = None
        if settings.prompt_kind == "text":
            words = _words(scene, answers, truth, photos, should_stop)
            ceiling = words_of_true_masks(
                truth,
                [task.object for task in tasks],
                {photo: scene.camera_of[photo] for photo in scene.looked_at},
                scene.photos(BETTER),
                detector_factory(),
                n_photos=BETTER.n_crop_views,
                should_stop=should_stop,
            )
    folder_name = truth_folder.resolve()
    return Evaluation(
        rows=tuple(_row(one, truth, labels) for one in returned),
        words=words,
        searches=searches,
        ceiling=ceiling,
        settings=settings,
        scene=folder_name.parent.name if folder_name.name == "truth" else folder_name.name,
        layout=truth.layout,
        photos=photos,
        looked_at=scene.looked_at,
        n_trained_on=len(set(photos) - set(held_out)),
        unplaced=truth.unplaced,
        left_out=tuple(name for name in wanted if name not in {task.object for task in tasks}),
        n_gaussians=len(scene.gaussians),
        stages=_stages(project),
    )


def _stages(project: ProjectFolder) -> tuple[tuple[str, float, float], ...]:
    records = ((stage, project.stage_record(stage)) for stage in ("photos", "cameras", "masks", "training"))
    return tuple((stage, float(done["wall_seconds"]), float(done["cpu_seconds"])) for stage, done in records if done)


def _held_out(project: ProjectFolder) -> tuple[str, ...]:
    figures = (project.stage_record("training") or {}).get("figures", {})
    return tuple(figures.get("held_out") or ())


def _compared(truth: GroundTruth, held_out: Sequence[str], settings: EvaluationSettings) -> tuple[str, ...]:
    photos = truth.photos if settings.views == "all" else tuple(name for name in truth.photos if name in held_out)
    if not photos:
        raise SettingsError(
            f"Training saw all of the {len(truth.photos)} photos with true masks. Compare those with --views all; the "
            "table then states that."
        )
    return photos


def _wanted(truth: GroundTruth, settings: EvaluationSettings) -> tuple[str, ...]:
    unknown = [name for name in settings.objects if name not in truth.objects]
    if unknown:
        raise SettingsError(f"There are no true masks of {unknown[0]!r}, only of: {', '.join(truth.objects)}.")
    return tuple(name for name in truth.objects if not settings.objects or name in settings.objects)


def _tasks(
    truth: GroundTruth, wanted: Sequence[str], photos: Sequence[str], settings: EvaluationSettings
) -> list[_Task]:
    """Return the objects to ask for, without those that no photo is left to compare in."""
    shown: dict[str, dict[str, tuple[bool, float]]] = {name: {} for name in wanted}
    for photo in truth.photos:
        for name, mask in truth.masks(photo).items():
            if name in shown:
                cut = bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
                shown[name][photo] = (not cut, float(mask.mean()))
    tasks = []
    for name, sizes in shown.items():
        looked_at = [photo for photo in photos if photo in sizes]
        question = Question(settings.prompt_kind, _EVERYTHING)
        if settings.prompt_kind == "text":
            question = Question("text", truth.prompts[name])
        elif settings.prompt_kind != "all" and sizes:
            # Photos that show the object whole come first, then the largest. If all are compared, one is given up.
            spare = [photo for photo in sizes if photo not in looked_at]
            question = Question(settings.prompt_kind, name, max(spare or sizes, key=lambda photo: sizes[photo]))
        others = tuple(photo for photo in looked_at if photo != question.prompt_photo)
        if others:
            tasks.append(_Task(name, question, others))
    if not tasks:
        raise SettingsError(
            f"None of {', '.join(wanted)} is in two photos: there is nothing to compare. Use --views all."
        )
    return tasks


def _questions(tasks: Sequence[_Task], truth: GroundTruth, settings: EvaluationSettings) -> list[Question]:
    """Return the questions in order. Equal objects share one text, which is asked for once."""
    questions = list(dict.fromkeys(task.question for task in tasks))
    if settings.prompt_kind == "text" and not settings.objects:
        questions += [Question("text", text) for text in truth.absent]
    return questions


def _ask(
    scene: TrainedScene,
    questions: Sequence[Question],
    methods: Sequence[Method],
    truth: GroundTruth,
    emit: Emit,
    should_stop: StopCheck,
) -> dict[tuple[Question, str], Answer]:
    answers = {}
    pairs = [(question, method) for question in questions for method in methods]
    for number, (question, method) in enumerate(pairs):
        if should_stop():
            raise Cancelled("Stopped while isolating; nothing was written.")
        emit(Progress(STAGE, _ISOLATION_SHARE * number / len(pairs), message=f"{question.name}: {method.name}"))
        answers[question, method.name] = scene.answer(question, method, truth, should_stop)
    return answers


def _match(
    tasks: Sequence[_Task],
    methods: Sequence[Method],
    answers: Answers,
    truth: GroundTruth,
    labels: NDArray[np.int32] | None,
) -> list[_Returned]:
    """Return what counts for each object, with each method."""
    returned = []
    for task in tasks:
        for method in methods:
            answer = answers[task.question, method.name]
            returned.append(_Returned(task, method, answer, _own(task, answer, truth, labels), []))
    return returned


def _own(task: _Task, answer: Answer, truth: GroundTruth, labels: NDArray[np.int32] | None) -> Mask | None:
    """Return the result that counts for an object: the first, unless equal objects share one text.

    Then as many results as there are objects count. They are assigned to the objects so that the sum of the IoU of the
    Gaussians is largest.
    """
    prompt = truth.prompts[task.object]
    equal = [name for name in truth.objects if truth.prompts[name] == prompt]
    if task.question.kind != "text" or labels is None or len(equal) == 1:
        return answer.found[0] if answer.found else None
    found = answer.found[: len(equal)]
    likeness = np.array(
        [[gaussian_iou(one, labels, truth.objects.index(name)) for one in found] for name in equal]
    ).reshape(len(equal), len(found))
    given = dict(zip(*linear_sum_assignment(likeness, maximize=True), strict=True))
    number = given.get(equal.index(task.object))
    return None if number is None else found[number]


def _match_all(
    scene: TrainedScene,
    tasks: Sequence[_Task],
    methods: Sequence[Method],
    answers: Answers,
    truth: GroundTruth,
    photos: Sequence[str],
    should_stop: StopCheck,
) -> tuple[list[_Returned], tuple[Search, ...]]:
    """Return what counts for each object in searches for all objects, and the results of the searches.

    Results are assigned to objects so that the sum of the mean IoU in the compared photos is largest. Objects that are
    not wanted take part, so that a result for them is not called false.
    """
    returned, searches = [], []
    for method in methods:
        answer = answers[tasks[0].question, method.name]
        compared = compare_with_all(
            scene.new_scene(), scene.camera_of, answer.found, truth, photos, should_stop=should_stop
        )
        likeness = np.nan_to_num(compared.iou)
        pairs = zip(*linear_sum_assignment(likeness, maximize=True), strict=True)
        number_of = {truth.objects[m]: int(k) for k, m in pairs if likeness[k, m] > 0}
        object_of = {k: name for name, k in number_of.items()}
        results = []
        for k, (name, score) in enumerate(zip(answer.names, answer.scores, strict=True)):
            own = object_of.get(k, "")
            iou = float(likeness[k, truth.objects.index(own)]) if own else 0.0
            results.append(Result(name, float(score), own, iou, _kind(iou, compared, k)))
        searches.append(Search(method.name, tuple(results), answer.seconds, answer.cpu_seconds))
        for task in tasks:
            number = number_of.get(task.object)
            members = None if number is None else answer.found[number]
            returned.append(_Returned(task, method, answer, members, []))
    order = {task.object: number for number, task in enumerate(tasks)}
    return sorted(returned, key=lambda one: order[one.task.object]), tuple(searches)


def _kind(iou: float, compared: Comparison, k: int) -> ResultKind:
    if iou >= FOUND_IOU:
        return "object"
    if compared.n_shown[k] == 0:
        return "unseen"
    return "ignored" if 2 * compared.n_ignored[k] > compared.n_shown[k] else "false"


def _words(
    scene: TrainedScene, answers: Answers, truth: GroundTruth, photos: Sequence[str], should_stop: StopCheck
) -> tuple[Word, ...]:
    """Return what the first result of every text shows, and what a refused text is offered."""
    first = [(question, answer.found[0]) for (question, _), answer in answers.items() if answer.found]
    named = np.array(
        [[truth.prompts[name] == question.name for name in truth.objects] for question, _ in first], bool
    ).reshape(len(first), len(truth.objects))
    compared = compare_with_all(
        scene.new_scene(),
        scene.camera_of,
        [members for _, members in first],
        truth,
        photos,
        with_boundary=named,
        should_stop=should_stop,
    )
    numbers = iter(range(len(first)))
    refused = [(question, members) for (question, _), answer in answers.items() for members in answer.offered
               if question.name in truth.prompts.values()]  # fmt: skip
    offered = compare_with_all(
        scene.new_scene(), scene.camera_of, [members for _, members in refused], truth, photos,
        with_boundary=np.zeros((len(refused), len(truth.objects)), bool), should_stop=should_stop,
    ).iou  # fmt: skip
    offers = iter(range(len(refused)))
    words = []
    for (question, method), answer in answers.items():
        absent = question.name not in truth.prompts.values()
        iou = boundary_iou = float("nan") if absent else 0.0
        shows = ""
        if answer.found:
            k = next(numbers)
            likeness = np.nan_to_num(compared.iou[k])
            best = int(likeness.argmax())
            shows = truth.objects[best] if likeness[best] >= FOUND_IOU else ""
            if not absent:
                own = int(np.where(named[k], likeness, -1.0).argmax())
                iou, boundary_iou = float(likeness[own]), float(compared.boundary_iou[k, own])
        names_it = [truth.prompts[name] == question.name for name in truth.objects]
        ious = [] if absent else [float(np.nan_to_num(offered[next(offers)])[names_it].max()) for _ in answer.offered]
        score = float(answer.scores[0]) if answer.found else answer.best_score
        words.append(
            Word(
                prompt=question.name,
                method=method,
                absent=absent,
                n_results=len(answer.found),
                score=score,
                iou=iou,
                boundary_iou=boundary_iou,
                shows=shows,
                seconds=answer.seconds,
                cpu_seconds=answer.cpu_seconds,
                remark=answer.refusal,
                offered_iou=max(ious, default=float("nan") if absent or answer.found else 0.0),
            )
        )
    return tuple(words)


def _score(
    scene: TrainedScene,
    returned: Sequence[_Returned],
    truth: GroundTruth,
    photos: Sequence[str],
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Add the scores of every photo to what is compared in it."""
    whole = scene.new_scene()
    for number, photo in enumerate(photos):
        if should_stop():
            raise Cancelled("Stopped while comparing; nothing was written.")
        share = _ISOLATION_SHARE + (1 - _ISOLATION_SHARE) * number / len(photos)
        emit(Progress(STAGE, share, message=f"Comparing with {photo}"))
        masks = truth.masks(photo)
        here = [one for one in returned if photo in one.task.photos]
        scores = score_photo(
            whole,
            scene.camera_of[photo],
            scene.photo_folder / photo,
            [one.members for one in here],
            [masks[one.task.object] for one in here],
        )
        for one, score in zip(here, scores, strict=True):
            one.scores.append(score)


def _row(returned: _Returned, truth: GroundTruth, labels: NDArray[np.int32] | None) -> Row:
    task, answer = returned.task, returned.answer
    means = Scores(*(mean_of(values) for values in zip(*returned.scores, strict=True)))
    searched = task.question.kind == "all"
    missing = "No result shows it." if searched else "Fewer objects were found than there are."
    return Row(
        object=task.object,
        method=returned.method.name,
        returned=returned.members is not None,
        **means._asdict(),
        gaussian_iou=float("nan")
        if labels is None
        else gaussian_iou(returned.members, labels, truth.objects.index(task.object)),
        seconds=float("nan") if searched else answer.seconds,
        cpu_seconds=float("nan") if searched else answer.cpu_seconds,
        n_views=len(returned.scores),
        prompt_photo=task.question.prompt_photo or "",
        remark=answer.refusal or ("" if returned.members is not None else missing),
    )
