"""Fixtures: random Gaussians from a seed, and their comparison; the validator of glTF."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.scene.gaussians import Gaussians
from tests.conftest import PATIENCE

RandomGaussians = Callable[..., Gaussians]
GlbErrors = Callable[[Path], list[dict[str, Any]]]
_VALIDATOR = "gltf-validator@2.0.0-dev.3.10"


def _random_gaussians(count: int, *, degree: int = 3, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, dtype=np.float32)

    return Gaussians(
        means=normal(count, 3),
        log_scales=normal(count, 3) - 3,
        quats=normal(count, 4),
        opacity_logits=4 * normal(count),
        sh=0.3 * normal(count, (degree + 1) ** 2, 3),
    )


def _assert_same_gaussians(actual: Gaussians, expected: Gaussians) -> None:
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        got, wanted = getattr(actual, name), getattr(expected, name)
        assert got.dtype == wanted.dtype == np.float32, name
        np.testing.assert_array_equal(got, wanted, err_msg=name)


@pytest.fixture
def random_gaussians() -> Callable[..., Gaussians]:
    """Return ``random_gaussians(count, degree=3, seed=0)``: quats of any length, opacities up to near 0 and 1."""
    return _random_gaussians


@pytest.fixture
def assert_same_gaussians() -> Callable[[Gaussians, Gaussians], None]:
    """Return a function that compares Gaussians bit for bit, including shapes and types."""
    return _assert_same_gaussians


@pytest.fixture(scope="session")
def glb_errors(tmp_path_factory: pytest.TempPathFactory) -> GlbErrors:
    """Return a function that gives the errors and warnings of Khronos' glTF validator about a file.

    GAUSSIAN_HERITAGE_NPM_CACHE names a folder with the validator that is kept between runs.
    """
    cache = os.environ.get("GAUSSIAN_HERITAGE_NPM_CACHE")
    folder = Path(cache) if cache else tmp_path_factory.mktemp("validator")
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed here")
    validator = folder / "node_modules" / "gltf-validator"
    if not validator.is_dir():
        install = ["npm", "install", "--silent", "--prefix", str(folder), _VALIDATOR]
        subprocess.run(install, check=True, timeout=PATIENCE)

    def errors_of(path: Path) -> list[dict[str, Any]]:
        script = (
            f"const v = require({json.dumps(str(validator))});"
            f"v.validateBytes(new Uint8Array(require('fs').readFileSync({json.dumps(str(path))})))"
            ".then(r => console.log(JSON.stringify(r.issues.messages)))"
        )
        result = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=True, timeout=PATIENCE)
        return [message for message in json.loads(result.stdout) if message["severity"] <= 1]

    return errors_of
