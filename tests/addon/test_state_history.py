"""Undo stores again what this session stored before, and never replaces what another program stored."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from .conftest import PACKAGE

StateHistory = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.state_history").StateHistory
VASE = ("project", "vase", "state")


class Project:
    """One place of a project, and what was stored in it."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def store(self, value: Any) -> None:
        self.value = value


def follow(history: Any, project: Project, wanted: Any, **options: Any) -> bool:
    return bool(history.follow(VASE, wanted, project.value, project.store, **options))


def test_values_of_this_session_follow_back_and_forth() -> None:
    history, project = StateHistory(), Project("second")
    history.remember(VASE, None, "first")
    history.remember(VASE, "first", "second")
    for wanted in ("first", None, "first", "second"):
        assert history.waits(VASE, wanted)
        assert not follow(history, project, wanted) and project.value == wanted
        assert not history.waits(VASE, wanted)


def test_another_value_is_kept_and_told_once() -> None:
    history, project = StateHistory(), Project("theirs")
    history.remember(VASE, "first", "second")
    assert follow(history, project, "first") and project.value == "theirs"
    assert not follow(history, project, "first"), "told once"
    history.remember(VASE, "theirs", "third")
    project.value = "third"
    assert not history.waits(VASE, "first"), "this session did not lead from there to what is stored"
    assert not follow(history, project, "theirs") and project.value == "theirs"


def test_value_that_the_project_has_already_is_not_stored() -> None:
    history = StateHistory()
    history.remember(VASE, "first", "second")
    stored: list[str] = []
    assert not history.follow(VASE, "first", "first", stored.append) and stored == []
    assert history.last(VASE) == "first"


@pytest.mark.parametrize("always", [True, False])
def test_only_names_and_records_follow_to_values_that_are_new(always: bool) -> None:
    history, project = StateHistory(), Project("Vase")
    history.agree(VASE, "Vase")
    follow(history, project, "Urn", always=always)
    assert project.value == ("Urn" if always else "Vase")


def test_what_could_not_be_stored_is_not_tried_again_until_something_else_is_shown() -> None:
    history, project = StateHistory(), Project("Vase")
    history.agree(VASE, "Vase")
    history.refuse(VASE, "Urn")
    assert not history.waits(VASE, "Urn", always=True)
    follow(history, project, "Jug", always=True)
    assert project.value == "Jug" and history.waits(VASE, "Urn", always=True)


def test_nothing_follows_behind_the_loading_of_a_file() -> None:
    history, project = StateHistory(), Project("second")
    history.remember(VASE, "first", "second")
    history.clear()
    assert not follow(history, project, "first") and project.value == "second"
    assert history.names_of("project", "state") == []
