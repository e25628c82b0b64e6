"""Jobs of a project: reconstructing, isolating objects, stopping and continuing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, HTTPException, Request
from pydantic import BaseModel, Field

from ...core.errors import ProjectError, PromptError, SettingsError
from ...core.files import object_file
from ...project.objects import RECORD_FILE
from ...project.refused_prompts import read_offer
from ...scene import FISHEYE_LENS
from ...training.settings import DEFAULT_PRESET, OFFERED_PRESETS
from ...workers.jobs import Click, any_word_arguments, click_arguments, refine_arguments, text_arguments
from ..access import CurrentProject, CurrentUser, server_of
from ..contents import has_scene
from ..library import WebProject
from ..settings import ServeSettings
from ..texts import Line
from ..videos import frames_arguments
from ..word_models import describe_offer

router = APIRouter(prefix="/projects/{project_id}/jobs", tags=["jobs"])
if TYPE_CHECKING:
    _Preset = str
else:
    _Preset = Literal[tuple(one.name for one in OFFERED_PRESETS)]
_Pixel = Annotated[float, Field(ge=0, le=1e5, allow_inf_nan=False)]


class ClickedPixel(BaseModel):
    """A click on a photo, in pixels from its top left corner after EXIF rotation."""

    photo: Line = Field(max_length=200)
    x: _Pixel
    y: _Pixel
    wanted: bool = True


class Reconstruction(BaseModel):
    """Photos to a scene."""

    kind: Literal["reconstruct"]
    preset: _Preset = DEFAULT_PRESET
    mask_background: bool = False
    fisheye: bool = False
    light: bool = False


class Frames(BaseModel):
    """A video to photos, in the place of those that were taken from it before."""

    kind: Literal["frames"]
    video: str = Field(max_length=300)
    density: float = Field(default=1.0, ge=0.25, le=8.0)


class Segmentation(BaseModel):
    """A scene to objects, by exactly one of prompt, clicks, find_all, background, accept, detail and any_word.

    `detail` is for `object`, or for all objects without one; `any_word` fetches the model that was offered for texts
    that were not found, and asks for them again.
    """

    kind: Literal["segment"]
    prompt: Line = ""
    clicks: list[ClickedPixel] = []
    name: Line = Field(default="", max_length=300)
    object: Line = Field(default="", max_length=300)
    find_all: bool = False
    background: bool = False
    detail: bool = False
    any_word: bool = False
    accept: int | None = Field(default=None, ge=0, le=1000)


@router.post("", status_code=202)
def start_job(
    wanted: Annotated[Reconstruction | Frames | Segmentation, Field(discriminator="kind")],
    project: CurrentProject,
    request: Request,
    user: CurrentUser,
) -> dict[str, Any]:
    """Start a job, after those that wait already."""
    server = server_of(request)
    folders = {one.folder for one in server.library(user).projects()}
    if server.queue.n_waiting(folders) >= server.settings.max_waiting:
        raise ProjectError(f"{server.settings.max_waiting} of your jobs are waiting, which is the limit.")
    if isinstance(wanted, Reconstruction):
        arguments = _reconstruction(project, wanted, server.settings)
    elif isinstance(wanted, Frames):
        arguments = frames_arguments(project, project.video(wanted.video), wanted.density)
    else:
        arguments = _segmentation(project, wanted, server.settings)
    return dict(vars(server.queue.submit(project, arguments)))


@router.delete("/{job_id}", status_code=204)
def stop_job(job_id: str, project: CurrentProject, request: Request) -> None:
    """Stop a running job, whose finished work is kept, or remove a waiting one."""
    server_of(request).queue.cancel(project.folder, job_id)


@router.post("/{job_id}/continue", status_code=202)
def continue_job(job_id: str, project: CurrentProject, request: Request) -> dict[str, Any]:
    """Start a stopped job again; it continues with the work that is finished."""
    return dict(vars(server_of(request).queue.resume(project, job_id)))


def _reconstruction(project: WebProject, wanted: Reconstruction, settings: ServeSettings) -> list[str]:
    if not project.photo_names():
        raise ProjectError("Upload photos first.")
    return [
        "reconstruct", str(project.photos), f"--out={project.project}", f"--preset={wanted.preset}", *_device(settings),
        *(["--mask-background"] if wanted.mask_background else []), *(["--light"] if wanted.light else []),
        *([f"--lens={FISHEYE_LENS}"] if wanted.fisheye else []),
    ]  # fmt: skip


def _segmentation(project: WebProject, wanted: Segmentation, settings: ServeSettings) -> list[str]:
    if not has_scene(project):
        raise ProjectError("The scene is not reconstructed yet.")
    ways = [bool(wanted.prompt.strip()), bool(wanted.clicks), wanted.find_all, wanted.background, wanted.detail]
    ways.append(wanted.any_word)
    if sum(ways) + (wanted.accept is not None) != 1:
        raise SettingsError("Give exactly one of prompt, clicks, find_all, background, accept, detail and any_word.")
    settings.require_short(wanted.prompt)
    if len(wanted.clicks) > settings.max_clicks:
        raise PromptError(f"A prompt has at most {settings.max_clicks} clicks.")
    own = project.own_words_options()
    return ["segment", str(project.project), *_prompt(project, wanted, settings), *_device(settings), *own]


def _device(settings: ServeSettings) -> list[str]:
    return [f"--device={settings.device}"] if settings.device != "auto" else []


def _prompt(project: WebProject, wanted: Segmentation, settings: ServeSettings) -> list[str]:
    name = wanted.name.strip()
    if wanted.find_all:
        return ["--all"]
    if wanted.background:
        return ["--complement"]
    if wanted.detail:
        return [f"--detail={_known_object(project, wanted.object)}"] if wanted.object else ["--detail"]
    if wanted.any_word:
        return _any_word(project, settings)
    if wanted.accept is not None:
        return [f"--accept={wanted.accept}"]
    if wanted.prompt.strip():
        return text_arguments(wanted.prompt, name)
    known = set(project.photo_names())
    for click in wanted.clicks:
        if click.photo not in known:
            raise PromptError(f"There is no photo {click.photo!r}.")
    clicks = [Click(one.photo, one.x, one.y, one.wanted) for one in wanted.clicks]
    if wanted.object:
        return refine_arguments(_known_object(project, wanted.object), clicks)
    return click_arguments(clicks, name)


def _any_word(project: WebProject, settings: ServeSettings) -> list[str]:
    not_found = read_offer(project.project)
    offer = describe_offer(not_found.offer, settings)
    if offer is not None and offer["refusal"]:
        raise HTTPException(403, offer["refusal"])
    return any_word_arguments([one.text for one in not_found.refusals], not_found.offer)


def _known_object(project: WebProject, object_id: str) -> str:
    if not object_file(project.project, object_id, RECORD_FILE).is_file():
        raise PromptError("There is no such object.")
    return object_id
