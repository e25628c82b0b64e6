"""``pip install .`` is all that a remote worker needs: the wheel, in an environment of its own, does a whole scene."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from distributed import Client

from benchmarks.batch.runs import Cluster
from engine.core.events import ignore_events, never_stop
from engine.workers.batch import BatchSettings, run_batch
from tests.contracts.test_requirements import build_wheel
from tests.engine.museum import write_photos


@pytest.mark.slow
def test_worker_of_the_installed_wheel_reconstructs_a_scene(tmp_path: Path) -> None:
    wheel = build_wheel(tmp_path)
    home = tmp_path / "environment"
    venv.create(home, with_pip=False)
    python = home / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel]
    subprocess.run([str(word) for word in pip], check=True, capture_output=True)
    # The packages that the wheel asks for are those of this environment: torch is not downloaded again.
    (site,) = home.glob("lib/python*/site-packages") if os.name != "nt" else [home / "Lib" / "site-packages"]
    (site / "shared.pth").write_text(sysconfig.get_paths()["purelib"])
    cluster = Cluster(tmp_path / "cluster")
    address = cluster.start_scheduler()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    words = [address, "--nthreads=1", "--resources", "MEMORY=6e9", "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen(
        [str(python), "-m", "distributed.cli.dask_worker", *words, f"--local-directory={tmp_path}"],
        cwd=home, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    cluster.workers.append(worker)
    try:
        photos = write_photos(tmp_path / "room", size=(384, 288))
        settings = BatchSettings(
            out=tmp_path / "scenes", scheduler=address, ship=True, arguments=("--preset=test", "--no-objects")
        )
        result = run_batch([photos], settings, emit=ignore_events, should_stop=never_stop)
        with Client(address, set_as_default=False) as client:
            (spec,) = client.run(importlib.util.find_spec, "engine").values()
    finally:
        cluster.stop()
    assert Path(spec.origin).is_relative_to(home)
    (folder,) = result.folders
    assert (folder.state, folder.error) == ("done", "")
    assert folder.computed == ["photos", "cameras", "training", "report"]
    assert (folder.out / "gaussians" / "scene.ply").is_file()
