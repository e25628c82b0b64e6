"""The tests of `test_gpu_steps` on a graphics card: ``pytest -m gpu tests/engine/training``."""

from __future__ import annotations

import pytest

from .test_gpu_steps import (  # noqa: F401
    opened_gpu,
    test_a_card_trains_as_well_as_the_processor,
    test_a_run_begun_on_a_card_continues_on_the_processor_and_back,
    test_training_on_a_card_that_is_killed_continues_from_its_checkpoint,
    test_trials_are_made_on_the_card,
    test_two_runs_give_the_same_bits_and_a_cancelled_one_continues_exactly,
    whole,
)

pytestmark = pytest.mark.gpu
