"""Prompts and clicks become arguments of the engine's command line."""

from __future__ import annotations

import pytest

from engine.core import errors
from engine.workers import jobs as prompts
from engine.workers.jobs import Click


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
