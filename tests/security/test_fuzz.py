"""Damaged files are refused with a sentence, never with another exception: the quick part of `make fuzz`."""

from __future__ import annotations

import ast
import importlib.util
import logging
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

import pytest

from benchmarks.security.fuzz_inputs import Outcome, Workplace, corpus, outcome_of, quick_numbers
from benchmarks.security.mutations import KINDS
from benchmarks.security.readers import READERS, Reader
from tests.conftest import ROOT

DAMAGED = ROOT / "tests" / "fixtures" / "damaged"
BY_NAME = {reader.name: reader for reader in READERS}
HAS_OPENUSD = importlib.util.find_spec("pxr") is not None
"""It is optional; without it there are no readers of USD."""
CASES = [case for case in corpus(DAMAGED) if HAS_OPENUSD or not case[0].startswith("usd-")]
SEED = 20
"""Another one than that of `make fuzz`."""

SLOW = {
    "colmap-binary": 2,
    "colmap-text": 2,
    "transforms-with-cloud": 2,
    "embedding": 12,
    "groups": 30,
    "checkpoint": 30,
    "report-plot": 12,
    "usd-a": 12,
    "usd-c": 12,
}
"""Numbers of inputs of readers that start a process or take milliseconds for each."""
SLOW |= {reader.name: 12 for reader in READERS if reader.name.startswith("photo-") and "blender" not in reader.name}
N_INPUTS = 60
MAX_WALL_SECONDS = 300
"""Long enough for the slowest test on a busy computer."""

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="a reader that hangs could not be ended")

READING = {
    *(
        "read_json",
        "read_array",
        "read_arrays",
        "opened",
        "read_text",
        "read_bytes",
        "read_kept_arrays",
        "read_versioned",
    ),
    *("parse_json", "fromfile", "memmap", "frombuffer", "ZipFile", "Reconstruction", "import_PLY", "opened_package"),
}
MODULES_THAT_READ = {"json", "np", "torch", "Image", "tarfile", "pickle"}
"""``load``, ``loads`` and ``open`` of these read, too."""
NOT_REACHED = {
    "engine/cameras/matching.py:match_share": "what the engine that waits for this process has just written",
    "engine/objects/detailing.py:_make_with_helpers": "what processes state while the engine waits for them",
    "engine/core/child_process.py": "what the parent process and the system state",
    "engine/serve/page_files.py": "the built page",
    "engine/workers/jobs/click_preview.py": "what the add-on and the engine tell each other while they run",
    "gaussian_heritage_addon/setup/preferences.py:_stored_problem": "in Blender alone: its tests are in tests/blender",
    "engine/core/system/machine.py": "what the system states",
    "engine/rasterizer/jit.py": "our own source code",
    "engine/rasterizer/gpu/": "the memory of the card, and our own source code",
    "engine/training/gpu/": "the memory of the card",
    "engine/training/losses/exposure.py": "the memory of the card",
    "engine/core/lazy_exports.py": "our own source code",
    "engine/cameras/model_reading.py:_converted": "reached in a child process, by colmap-binary and colmap-text",
    "engine/cameras/model_reading.py:_names_of_text_model": "reached in a child process, by colmap-text",
    "engine/cameras/model_reading.py:cloud_in_child": "reached in a child process, by transforms-with-cloud",
    "engine/cameras/model_reading.py:_stated_points": "reached in a child process, by transforms-with-cloud",
    "engine/cameras/triangulation.py:posed_model": "no file: a model is made",
    "engine/cameras/lens_trials.py:_with_own_lenses": "no file: a model is made",
    "engine/cameras/lens_trials.py:trial_of_file": "what the engine that waits for this process has just written",
    "engine/pipeline/stages.py:cameras_stage": "a part of the file that `cameras` reads whole",
    "engine/quality/stability/": "what the suite itself wrote",
    "engine/formats/sog_writing.py": "a file that is written",
    "engine/formats/mesh_usdz.py": "a file that is written",
    "gaussian_heritage_addon/splats/sog_pictures.py": "in Blender alone: the picture that it has just written",
    "engine/install/models/onnx_weights.py": "a weight file with a SHA-256 in the catalogue",
    "engine/objects/grounding/efficientnet.py": "a weight file with a SHA-256 in the catalogue",
    "engine/core/words/vocabulary_words.py:_read_rows": "our own word lists",
    "engine/objects/grounding/wholeness.py:_numbers": "our own weights",
    "engine/objects/grounding/pictures.py:_directions": "our own features",
    "engine/serve/asking.py:_address_of": "a picture that the engine has just written",
    "engine/core/language/reading.py:languages": "our own texts",
    "engine/install/environment/locked.py": "our own locked requirements",
    "engine/install/environment/target.py": "our own locked requirements",
    "engine/install/models/npm_package.py:_dist": "what the registry answers: its own tests",
    "engine/install/models/npm_settings.py:read_npm_settings": "settings of the user's own computer",
    "engine/install/environment/pip_command.py:Pip.offered": "what pip printed",
    "engine/install/environment/bundle.py:write_bundle": "the files that pip has just downloaded",
    "engine/install/models/packages.py:_run": "what npm or pip printed",
    "engine/install/models/download.py": "the file that was just received",
    "engine/core/system/processes.py": "what the system states",
    "engine/core/system/limits.py": "what the system states",
    "gaussian_heritage_addon/splats/render_settings.py:_former": "in Blender alone: its tests are in tests/blender",
    "engine/delivery/packages/page.py": "our own viewer, and the Gaussians that were just written",
}
"""Functions that need no entry among the readers, with the reason: mostly what they read instead of an input."""


@pytest.fixture(autouse=True)
def quiet() -> Iterator[None]:
    """Hide what is logged and warned about damaged files, and end a test that hangs."""

    def stop(*_: object) -> NoReturn:
        raise TimeoutError("the reader hangs")

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(MAX_WALL_SECONDS)
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    logging.disable(logging.NOTSET)
    signal.alarm(0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)


class Executed:
    """Functions of ours that were called, by file and qualified name."""

    def __init__(self) -> None:
        self.functions: set[tuple[str, str]] = set()

    def __enter__(self) -> Executed:
        threading.setprofile(self._note)
        sys.setprofile(self._note)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]

    def _note(self, frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            self.functions.add((frame.f_code.co_filename, frame.f_code.co_qualname))


@pytest.fixture(scope="module")
def executed() -> dict[str, set[tuple[str, str]]]:
    """Functions that the readers called for their valid inputs, by reader; filled by the tests."""
    return {}


def read_valid(reader: Reader, folder: Path, executed: dict[str, set[tuple[str, str]]]) -> Outcome:
    workplace = Workplace(reader, folder)
    with Executed() as calls:
        outcome = outcome_of(reader, workplace.folder)
    executed[reader.name] = calls.functions
    return outcome


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_the_undamaged_input_of_each_reader_is_accepted(
    reader: Reader, tmp_path: Path, executed: dict[str, set[tuple[str, str]]]
) -> None:
    outcome = read_valid(reader, tmp_path / "input", executed)
    assert (outcome.kind, outcome.error) == ("accepted", "")


def test_every_function_that_reads_a_file_is_among_the_readers(
    executed: dict[str, set[tuple[str, str]]], tmp_path: Path
) -> None:
    for reader in READERS:
        if reader.name not in executed:
            read_valid(reader, tmp_path / reader.name, executed)
    called = {(Path(file).resolve(), name) for file, name in set().union(*executed.values()) if str(ROOT) in file}
    missing = [
        f"{path.relative_to(ROOT)}:{name}"
        for path, name in reading_functions()
        if (path, name) not in called
        and (HAS_OPENUSD or path.name != "usd_reading.py")
        and not any(f"{path.relative_to(ROOT).as_posix()}:{name}".startswith(known) for known in NOT_REACHED)
    ]
    assert len(missing) == 0, f"{missing} must be reached: add an entry to benchmarks/security/readers*.py"


def reading_functions() -> Iterator[tuple[Path, str]]:
    """Yield file and qualified name of the functions that read, outside of the core that they call."""
    for package in ("engine", "gaussian_heritage_addon", "operators"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if (ROOT / "engine" / "core" / "files") not in path.parents:
                tree = ast.parse(path.read_text(encoding="utf-8"))
                yield from ((path, name) for name in dict.fromkeys(names_that_read(tree)))


def names_that_read(node: ast.AST, name: str = "") -> Iterator[str]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            inside = f"{name}.<locals>." if name and not isinstance(node, ast.ClassDef) else f"{name}." if name else ""
            yield from names_that_read(child, inside + child.name)
        elif isinstance(child, ast.ClassDef):
            yield from names_that_read(child, f"{name}.{child.name}" if name else child.name)
        else:
            if isinstance(child, ast.Call) and reads(child.func):
                yield name
            yield from names_that_read(child, name)


def reads(function: ast.expr) -> bool:
    if isinstance(function, ast.Name):
        return function.id in READING
    if not isinstance(function, ast.Attribute):
        return False
    if function.attr in ("load", "loads", "open"):
        return isinstance(function.value, ast.Name) and function.value.id in MODULES_THAT_READ
    return function.attr in READING


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}/{case[1]}")
def test_known_damage_is_accepted_or_refused_with_a_sentence(
    case: tuple[str, str, dict[str, Path]], tmp_path: Path
) -> None:
    name, _, files = case
    workplace = Workplace(BY_NAME[name], tmp_path / "input")
    workplace.replace(files)
    assert outcome_of(workplace.reader, workplace.folder).error == ""


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_new_damage_is_accepted_or_refused_with_a_sentence(reader: Reader, tmp_path: Path) -> None:
    workplace = Workplace(reader, tmp_path / "input")
    for number in quick_numbers(reader, SLOW.get(reader.name, N_INPUTS)):
        name = workplace.damage(SEED, number)
        assert outcome_of(reader, workplace.folder).error == "", f"input {number}"
        workplace.heal(name)


def test_the_same_number_is_the_same_damage(tmp_path: Path) -> None:
    one, two = (Workplace(BY_NAME["cameras"], tmp_path / name) for name in ("one", "two"))
    for number in range(30, 50):
        name = one.damage(3, number)
        two.damage(3, number)
        assert (one.folder / name).read_bytes() == (two.folder / name).read_bytes()
        one.heal(name)
        two.heal(name)


def test_other_exceptions_and_ignored_files_are_told_apart(tmp_path: Path) -> None:
    def broken(folder: Path) -> object:
        raise KeyError("x")

    reader = Reader("test", lambda folder: (folder / "a.json").write_text("{}"), broken, ("a.json",))
    assert outcome_of(reader, tmp_path).kind == "other"
    assert outcome_of(Reader("test", reader.write, lambda folder: None, ("a.json",)), tmp_path).kind == "refused"
    assert outcome_of(Reader("test", reader.write, lambda folder: 0, ("a.json",)), tmp_path).kind == "accepted"


def test_every_kind_of_file_has_damage_of_its_own() -> None:
    kinds = {Path(name).suffix[1:] for reader in READERS for name in reader.files}
    assert kinds <= set(KINDS)
    assert all(KINDS[kind] for kind in kinds)


def test_the_corpus_is_small_and_belongs_to_readers() -> None:
    sizes = [path.stat().st_size for _, _, files in CASES for path in files.values()]
    assert sum(sizes) < 300_000
    assert {name for name, _, _ in CASES} <= set(BY_NAME)
    assert all(set(files) <= set(BY_NAME[name].files) for name, _, files in CASES)
