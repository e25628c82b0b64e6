"""The tests of `test_gpu_detail` on a graphics card: ``pytest -m gpu tests/engine/training``."""

from __future__ import annotations

import pytest

from .gpu.conftest import opened_gpu  # noqa: F401
from .gpu.test_gpu_detail import (  # noqa: F401
    on_card,
    scene,
    test_gradients_of_a_step_are_those_of_the_processor,
    test_limits_order_the_scales_as_the_processor_does,
    test_no_gaussian_exceeds_the_limits_of_the_processor,
    test_training_is_as_good_as_on_the_processor,
    test_two_runs_give_the_same_bits_also_where_buffers_grow_for_more_pairs,
)

pytestmark = pytest.mark.gpu
