"""A process that answers while the user clicks: only the last question counts, and it ends with its user."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.workers.jobs import Click, ClickAnswer, ClickPreview, click_question, pack_mask, read_question
from engine.workers.jobs.click_preview import _answer
from tests.conftest import wait_until

ENGINE = """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    mask = {"width": 2, "height": 1, "bits": "gA=="}
    outputs = {"photo": asked["photo"], "masks": {"wanted": mask}}
    print(json.dumps({"v": 1, "kind": "finished", "time": 0.0, "message": "", "outputs": outputs}), flush=True)
"""


def answer_of(preview: ClickPreview) -> ClickAnswer:
    found: list[ClickAnswer] = []

    def take() -> bool:
        answer = preview.poll()
        found.extend([] if answer is None else [answer])
        return bool(found) and not preview.is_working

    wait_until(take)
    return found[-1]


def test_last_question_is_answered() -> None:
    preview = ClickPreview([sys.executable, "-c", ENGINE], dict(os.environ))
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        preview.ask(click_question(name, []))
    assert preview.is_working
    answer = answer_of(preview)
    assert answer.photo == "c.jpg" and not answer.problem
    np.testing.assert_array_equal(answer.masks["wanted"], [[True, False]])
    process = preview._process
    assert process is not None
    preview.close()
    wait_until(lambda: not process.poll())
    preview.close()
    preview.ask("late")
    assert preview.poll() is None


def test_process_that_ends_or_cannot_start_says_so(tmp_path: Path) -> None:
    for command in ([sys.executable, "-c", ""], [str(tmp_path / "nothing")]):
        preview = ClickPreview(command, dict(os.environ))
        answers: list[ClickAnswer] = []
        wait_until(lambda preview=preview, answers=answers: answers.extend(filter(None, [preview.poll()])) or answers)
        assert answers[0].problem
        preview.close()


def test_question_is_read_as_it_was_written() -> None:
    clicks = [Click("a b.jpg", 1.5, 2.0), Click("c.jpg", 3.0, 4.0, wanted=False)]
    assert read_question(click_question("a b.jpg", clicks, "vase")) == ("a b.jpg", clicks, "vase")
    for line in ("", "[]", '{"photo": 3}'):
        with pytest.raises(FormatError, match="question"):
            read_question(line)


@pytest.mark.parametrize("shape", [(3, 5), (480, 640), (4000, 3000)])
def test_mask_arrives_as_it_was_sent_in_the_size_of_a_viewport(shape: tuple[int, int]) -> None:
    mask = np.zeros(shape, bool)
    mask[: shape[0] // 2] = True
    got = _answer({"photo": "a", "masks": {"wanted": pack_mask(mask)}}).masks["wanted"]
    assert max(got.shape) <= 640 and abs(got.mean() - mask.mean()) < 0.01
    if max(shape) <= 640:
        np.testing.assert_array_equal(got, mask)


@pytest.mark.parametrize(
    "packed",
    [
        {"width": 10**9, "height": 10**9, "bits": ""}, {"width": 4, "height": 4, "bits": "no base64!"},
        {"width": -1, "height": -1, "bits": ""}, {"width": 9, "height": 9, "bits": "gA=="},
    ],
)  # fmt: skip
def test_impossible_mask_is_empty(packed: dict[str, object]) -> None:
    assert not _answer({"photo": "a", "masks": {"wanted": packed}}).masks["wanted"].any()
