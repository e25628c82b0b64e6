"""No test depends on how fast a computer is: clocks are read in few places, and limits only guard against hanging.

A limit of less than a minute expires on a busy machine, where a process may wait for seconds. A test waits with
`tests.conftest.wait_until`; where time itself is tested, the clock is replaced.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests.conftest import ROOT

from .sources import nodes

LEAST_SECONDS = 60.0
_CLOCKS = frozenset({"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time", "thread_time"})
_WAITS = frozenset({"wait", "join", "communicate"})
"""Methods whose first number is a limit in seconds."""
_LIMITS = frozenset({"timeout", "deadline", "max_seconds", "wait_seconds"})
"""Names of arguments that are limits in seconds."""
_PARAMETERS = _LIMITS | {"seconds"}
"""Names of parameters that are; as an argument, ``seconds`` may be what something took."""

READS_A_CLOCK = {
    "tests/conftest.py": "the limit of `wait_until`",
    "tests/engine/serve/conftest.py": "the limit of `wait_for_job`",
    "tests/security/test_kills.py": "what is waited for lasts at least as long as it says, on every machine",
}
"""Files that may read a clock, and why."""

SHORT_LIMITS = {
    "tests/engine/install/models/site.py": "ends connections of clients that are gone, so that the server can end",
    "tests/engine/photos/test_memory_budget.py": "a pause between two looks",
}
"""Files that may have a short limit, and why."""


def problems(source: str) -> Iterator[tuple[str, str]]:
    """Yield the kind, "clock" or "limit", and the place of each dependence on time in a test file."""
    for node in nodes(source):
        if isinstance(node, ast.Attribute) and node.attr in _CLOCKS and _is_name(node.value, "time"):
            yield "clock", f"{node.lineno}: reads time.{node.attr}"
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            yield from (("clock", f"{node.lineno}: reads {one.name}") for one in node.names if one.name in _CLOCKS)
        if isinstance(node, ast.Attribute) and node.attr == "RLIMIT_CPU":
            yield "clock", f"{node.lineno}: limits the CPU time"
        if isinstance(node, ast.Call):
            given = [(word.arg or "", word.value) for word in node.keywords]
            if isinstance(node.func, ast.Attribute) and node.func.attr in _WAITS and node.args:
                given.append(("timeout", node.args[0]))
            yield from (("limit", f"{value.lineno}: {name}") for name, value in given if _is_short(name, value))
        if isinstance(node, ast.FunctionDef):
            parameters = [*node.args.posonlyargs, *node.args.args][::-1]
            defaults = [*zip(parameters, node.args.defaults[::-1], strict=False)]
            keywords = zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
            defaults += [(arg, value) for arg, value in keywords if value]
            yield from (
                ("limit", f"{one.lineno}: {one.arg}")
                for one, value in defaults
                if _is_short(one.arg, value, _PARAMETERS)
            )
        if isinstance(node, ast.Assign) and _is_short("timeout", node.value):
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
            yield from (("limit", f"{node.lineno}: {name}") for name in names if name in _LIMITS)
        if isinstance(node, ast.For) and _is_counted_wait(node):
            yield "limit", f"{node.lineno}: waits a counted number of times"


def _is_name(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _is_short(name: str, value: ast.AST, limits: frozenset[str] = _LIMITS) -> bool:
    """Return whether an argument is a limit of less than a minute; 0 waits for nothing."""
    is_number = isinstance(value, ast.Constant) and type(value.value) in (int, float)
    return name in limits and is_number and 0 < value.value < LEAST_SECONDS  # type: ignore[attr-defined]


def _is_counted_wait(loop: ast.For) -> bool:
    """Return whether a loop over ``range`` sleeps, so that its count is a limit of time."""
    counts = isinstance(loop.iter, ast.Call) and _is_name(loop.iter.func, "range")
    calls = [node.func for node in ast.walk(loop) if isinstance(node, ast.Call)]
    return counts and any(isinstance(call, ast.Attribute) and call.attr == "sleep" for call in calls)


FILES = [
    file
    for file in sorted((ROOT / "tests").rglob("*.py"))
    # Playwright's limits are in milliseconds, and a count of seconds in a stage of the quick engine is no limit.
    if not file.is_relative_to(ROOT / "tests" / "web") and file.name != "quick_engine.py"
]


@pytest.mark.parametrize(("kind", "allowed"), [("clock", READS_A_CLOCK), ("limit", SHORT_LIMITS)])
def test_no_test_depends_on_time(kind: str, allowed: dict[str, str]) -> None:
    found = {
        file.relative_to(ROOT).as_posix(): [place for one, place in problems(file.read_text("utf-8")) if one == kind]
        for file in FILES
    }
    found = {file: places for file, places in found.items() if places}
    assert set(found) - set(allowed) == set(), {file: found[file] for file in set(found) - set(allowed)}
    assert set(allowed) - set(found) == set(), "no longer needed"


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("assert time.perf_counter() - begin < 1", "clock"),
        ("from time import monotonic", "clock"),
        ("resource.setrlimit(resource.RLIMIT_CPU, (1, 1))", "clock"),
        ("process.wait(20)", "limit"),
        ("thread.join(timeout=30)", "limit"),
        ("process.communicate(timeout=10)", "limit"),
        ("subprocess.run(command, timeout=5)", "limit"),
        ("def wait_for(what, seconds=20.0): pass", "limit"),
        ("def wait_for(what, *, timeout: float = 5): pass", "limit"),
        ("for _ in range(200):\n    time.sleep(0.05)", "limit"),
        ("call('sleep', max_seconds=0.3)", "limit"),
    ],
)
def test_dependence_on_time_is_reported(source: str, kind: str) -> None:
    assert [one for one, _ in problems(source)] == [kind]


@pytest.mark.parametrize(
    "source", ["process.wait()", "'; '.join(names)", "process.wait(PATIENCE)", "subprocess.run(command, timeout=600)"]
)
def test_what_does_not_depend_on_time_is_not_reported(source: str) -> None:
    assert list(problems(source)) == []
