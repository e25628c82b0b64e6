"""Large photos are decoded in a child process with limits: a photo can only reject itself."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.child_process import ChildFailure
from engine.core.errors import PhotoError
from engine.photos.inspection import inspect_photos
from engine.photos.loading import load_pixels, load_with_valid
from engine.photos.reading import read_photos
from tests.conftest import PATIENCE, ROOT

from .hostile import chunk, header, write_large_png
from .test_reading import SMALL, names, save, textured

_READ_WITH_LIMIT = """
import json, resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]), int(sys.argv[2])))
from engine.core.system import peak_memory
from engine.photos import load_pixels, read_photos
found = read_photos(Path(sys.argv[1]))
assert load_pixels(found.folder / found.photos[0].name, max_side=500).shape == (500, 500, 3)
children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
print(json.dumps([[p.name for p in found.photos], {p.name: p.reason for p in found.rejected}, peak_memory(), children]))
"""
_MEGABYTE = 1 << 20
_SIDE = 8200
"""Side in pixels of a picture that is just too large to be decoded in this process."""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits the address space")
def test_large_photos_take_little_memory_together(tmp_path: Path) -> None:
    """Each of them took 1.5 GB, and the second one ended the run."""
    for seed, name in enumerate(("a.png", "b.png")):
        write_large_png(tmp_path / name, _SIDE, _SIDE, seed=seed)
    assert (tmp_path / "a.png").stat().st_size < 4_000_000
    save(tmp_path / "c.png", textured(3, height=200, width=300))
    done = subprocess.run(
        [sys.executable, "-c", _READ_WITH_LIMIT, str(tmp_path), str(1200 * _MEGABYTE)],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    used, rejected, own, largest_child = json.loads(done.stdout)
    assert (used, rejected) == (["a.png", "b.png", "c.png"], {})
    assert own < 256 * _MEGABYTE
    # Twice the size of the decoded picture, which has 3 bytes per pixel.
    assert largest_child < 256 * _MEGABYTE + 2 * 3 * _SIDE**2


def test_photo_that_does_not_fit_is_rejected_with_its_name_and_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.photos.memory_budget.free_memory", lambda: 800_000_000)
    # Headers are sufficient: the files are rejected before anything is decoded.
    for name, side in (("a.png", 9000), ("b.png", 30_000)):
        (tmp_path / name).write_bytes(header(side, side) + chunk(b"IDAT", b"") + chunk(b"IEND", b""))
    save(tmp_path / "c.png", textured(0))
    used, rejected = names(tmp_path)
    assert used == ["c.png"]
    assert rejected["a.png"] == (
        "It has 9000 x 9000 pixels, which takes 0.7 GB of memory to read; at most 0.6 GB can be used now. "
        "Reduce its size, or close other programs."
    )
    assert rejected["b.png"] == (
        "It has 30000 x 30000 pixels, and at most 400 million pixels can be read safely. Reduce its size."
    )


def test_results_in_a_child_process_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path / "photos" / "a.jpg", textured(0), quality=90)
    save(tmp_path / "photos" / "b.png", np.dstack([textured(1), np.full((48, 64), 200, np.uint8)]))
    save(tmp_path / "mask.png", np.eye(48, 64, dtype=np.uint8) * 255)
    photos, mask = tmp_path / "photos", tmp_path / "mask.png"

    def results() -> list[object]:
        found = read_photos(photos, SMALL)
        loaded = [load_with_valid(photos / "a.jpg", mask, max_side=side) for side in (None, 32)]
        loaded += [load_with_valid(photos / name, None) for name in ("a.jpg", "b.png")]
        arrays = [None if values is None else values.tolist() for pair in loaded for values in pair]
        return [found, inspect_photos(found), arrays]

    here = results()
    calls = []
    monkeypatch.setattr("engine.photos.bounded._MAX_BYTES_HERE", 0)
    monkeypatch.setattr("engine.photos.bounded.is_large", lambda *headers: bool(calls.append(1)) or True)
    monkeypatch.setattr("engine.photos.loading.is_large", lambda *headers: True)
    assert results() == here
    assert calls


def test_child_without_enough_memory_rejects_its_photo_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path / "0.png", textured(0))
    save(tmp_path / "1.png", textured(1, height=1200, width=1200))
    monkeypatch.setattr("engine.photos.bounded.is_large", lambda one: one.height > 100)
    monkeypatch.setattr("engine.photos.bounded._CHILD_BYTES", -(48 << 20))
    used, rejected = names(tmp_path)
    assert used == ["0.png"]
    assert rejected["1.png"].startswith("It takes more memory than ")


@pytest.mark.parametrize(
    ("failure", "sentence"),
    [
        (ChildFailure("Too slow.", "time"), "It takes too long to read."),
        (ChildFailure("Reading a.png crashed (SIGXCPU).", "crash"), "It takes too long to read."),
        (ChildFailure("Reading a.png crashed (SIGSEGV).", "crash"), "It is damaged and cannot be read."),
    ],
    ids=["time", "CPU time", "crash"],
)
def test_child_that_fails_rejects_its_photo_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: ChildFailure, sentence: str
) -> None:
    for seed, name in enumerate(("a.png", "b.png")):
        save(tmp_path / name, textured(seed, height=48 + 8 * seed))

    def fail(*_: object, **__: object) -> None:
        raise failure

    monkeypatch.setattr("engine.photos.bounded.is_large", lambda one: one.height == 48)
    monkeypatch.setattr("engine.photos.bounded.run_in_child", fail)
    used, rejected = names(tmp_path)
    assert used == ["b.png"] and rejected["a.png"].startswith(sentence)


_WORK_WITHOUT_END = """
import json, sys, types
import engine.photos
from engine.photos.bounded import limited_call
def work(path):
    print("working", flush=True)
    while True:
        pass
sys.modules["engine.photos.endless"] = types.SimpleNamespace(work=work)
limited_call(**json.loads(sys.argv[1]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not limit CPU time")
def test_child_is_stopped_after_its_cpu_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It works until it is stopped, so that nothing depends on how fast this computer is."""
    save(tmp_path / "a.png", textured(0))
    monkeypatch.setattr("engine.photos.bounded._CPU_SECONDS", 1e-6)
    monkeypatch.setattr("engine.photos.bounded.is_large", lambda *headers: True)
    monkeypatch.setattr("engine.photos.loading.is_large", lambda *headers: True)

    def run_without_end(function: str, request: dict[str, Any], **_: object) -> None:
        assert function == "photos.bounded:limited_call"
        endless = json.dumps({**request, "module": "endless", "name": "work", "arguments": {}})
        command = [sys.executable, "-c", _WORK_WITHOUT_END, endless]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
        assert done.stdout == "working\n"
        raise ChildFailure(f"Reading a.png crashed ({signal.Signals(-done.returncode).name}).", "crash")

    monkeypatch.setattr("engine.photos.bounded.run_in_child", run_without_end)
    with pytest.raises(PhotoError, match=r"a\.png takes too long to read"):
        load_pixels(tmp_path / "a.png")
