"""Prompts and clicks become arguments of the engine's command line."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from .conftest import PACKAGE

prompts = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.prompts")
errors = importlib.import_module(f"{PACKAGE}.engine.errors")
Click, EventResult = prompts.Click, prompts.EventResult


def test_several_texts_are_one_prompt() -> None:
    assert prompts.text_arguments(" vase ;teapot;; ") == ["--prompt=vase;teapot"]
    assert prompts.text_arguments("vase", "Krug") == ["--prompt=vase", "--name=Krug"]


@pytest.mark.parametrize("prompt", ["", "  ", " ; "])
def test_empty_prompt_is_a_clear_error(prompt: str) -> None:
    with pytest.raises(errors.PromptError, match="Enter what to isolate"):
        prompts.text_arguments(prompt)


def test_one_name_for_several_objects_is_a_clear_error() -> None:
    with pytest.raises(errors.PromptError, match="2 objects cannot have the same name 'Krug'"):
        prompts.text_arguments("vase;teapot", "Krug")


def test_clicks_become_arguments() -> None:
    clicks = [Click("a b.jpg", 364, 500.25), Click("a b.jpg", 1, 2, wanted=False), Click("c.jpg", 3.5, 4)]
    words = ["--click=a b.jpg=364,500.25", "--not=a b.jpg=1,2", "--click=c.jpg=3.5,4"]
    assert prompts.click_arguments(clicks, "Krug") == [*words, "--name=Krug"]
    assert prompts.refine_arguments("vase", clicks) == ["--refine=vase", *words]
    assert prompts.refine_arguments("vase", level=0) == ["--refine=vase", "--level=0"]


def test_negative_clicks_alone_can_correct_but_not_isolate() -> None:
    away = [Click("a.jpg", 1, 2, wanted=False)]
    with pytest.raises(errors.PromptError, match="at least once"):
        prompts.click_arguments(away)
    assert prompts.refine_arguments("vase", away) == ["--refine=vase", "--not=a.jpg=1,2"]
    with pytest.raises(errors.PromptError, match="Click what belongs"):
        prompts.refine_arguments("vase")


def press(session: Any, key: str, *, shift: bool = False, at: tuple[float, float] = (1.0, 2.0)) -> Any:
    return session.handle(key, pressed=True, negative=shift, click=lambda wanted: Click("a.jpg", *at, wanted))


def test_clicks_are_collected_until_enter() -> None:
    session = prompts.ClickSession()
    assert press(session, "LEFTMOUSE") is EventResult.HANDLED
    assert press(session, "LEFTMOUSE", shift=True, at=(5, 6)) is EventResult.HANDLED
    assert press(session, "LEFTMOUSE", at=(7, 8)) is EventResult.HANDLED
    assert press(session, "BACK_SPACE") is EventResult.HANDLED
    assert press(session, "RET") is EventResult.CONFIRMED
    assert session.clicks == [Click("a.jpg", 1, 2), Click("a.jpg", 5, 6, wanted=False)]
    assert session.summary() == "1 on the object, 1 beside it"


def test_arrow_keys_change_the_photo_and_other_events_stay_with_blender() -> None:
    session = prompts.ClickSession()
    assert (press(session, "LEFT_ARROW"), session.step) == (EventResult.CHANGE_PHOTO, -1)
    assert (press(session, "RIGHT_ARROW"), session.step) == (EventResult.CHANGE_PHOTO, 1)
    assert press(session, "MIDDLEMOUSE") is press(session, "WHEELUPMOUSE") is EventResult.IGNORED
    assert press(session, "ESC") is press(session, "RIGHTMOUSE") is EventResult.CANCELLED
    released = session.handle("LEFTMOUSE", pressed=False, negative=False, click=lambda wanted: 1 / 0)
    assert released is EventResult.IGNORED and session.clicks == []
    assert press(session, "BACK_SPACE") is EventResult.HANDLED
