"""Clicks are collected until Enter is pressed."""

from __future__ import annotations

import importlib
from typing import Any

from .conftest import PACKAGE

click_session = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.jobs.click_session")
Click, EventResult = click_session.Click, click_session.EventResult


def press(session: Any, key: str, *, shift: bool = False, at: tuple[float, float] = (1.0, 2.0)) -> Any:
    return session.handle(key, pressed=True, negative=shift, click=lambda wanted: Click("a.jpg", *at, wanted))


def test_clicks_are_collected_until_enter() -> None:
    session = click_session.ClickSession()
    assert press(session, "LEFTMOUSE") is EventResult.HANDLED
    assert press(session, "LEFTMOUSE", shift=True, at=(5, 6)) is EventResult.HANDLED
    assert press(session, "LEFTMOUSE", at=(7, 8)) is EventResult.HANDLED
    assert press(session, "BACK_SPACE") is EventResult.HANDLED
    assert press(session, "RET") is EventResult.CONFIRMED
    assert session.clicks == [Click("a.jpg", 1, 2), Click("a.jpg", 5, 6, wanted=False)]
    assert session.counts() == (1, 1)


def test_arrow_keys_change_the_photo_and_other_events_stay_with_blender() -> None:
    session = click_session.ClickSession()
    assert (press(session, "LEFT_ARROW"), session.step) == (EventResult.CHANGE_PHOTO, -1)
    assert (press(session, "RIGHT_ARROW"), session.step) == (EventResult.CHANGE_PHOTO, 1)
    assert press(session, "MIDDLEMOUSE") is press(session, "WHEELUPMOUSE") is EventResult.IGNORED
    released = session.handle("LEFTMOUSE", pressed=False, negative=False, click=lambda wanted: 1 / 0)
    assert released is EventResult.IGNORED and session.clicks == []
    assert press(session, "BACK_SPACE") is EventResult.HANDLED
