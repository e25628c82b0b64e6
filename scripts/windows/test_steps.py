"""The project's own tests, run by Windows' pytest."""

from __future__ import annotations

import dataclasses
import functools
import re
import shutil
from collections.abc import Mapping
from pathlib import Path, PureWindowsPath

from .launch import CODE_PAGES, USER, Windows
from .linux_only import BLENDER, GROUPS, IN_BLENDER, NOT_ON_WINDOWS, QUICK, WITH_MODELS
from .problem import Problem
from .steps import Context, Step

_MAX_SECONDS = 7200.0
_MAX_SECONDS_OF_A_TEST = 1200
_SHOWN_FAILURES = 12


def test_steps(*, quick: bool) -> list[Step]:
    """Return a step for each group of tests; `quick`: only those of `QUICK`."""
    names = QUICK if quick else tuple(GROUPS)
    computer = Step("the computer itself", check_computer)
    groups = [Step(f"tests: {name}", functools.partial(_run_group, name)) for name in names]
    return [computer, *groups]


def check_computer(context: Context) -> str:
    """Check what the other steps rely on: the user, the code pages, and the limit of a path."""
    computer = context.computer("tests", max_path=260)
    script = Path(__file__).with_name("computer_check.py")
    for page in CODE_PAGES:
        one = dataclasses.replace(computer, code_page=page)
        done = one.run([one.tests_python, script, USER, page.removeprefix("cp"), "260"], timeout=_MAX_SECONDS)
        if done.code:
            raise Problem(f"{page}: {done.err.strip()[-300:] or done.out[-300:]}")
    return f"user, folders, code pages {', '.join(CODE_PAGES)}, limit of 260 characters, in child processes too"


def _run_group(name: str, context: Context) -> str:
    """Run the tests of a group and return their numbers."""
    missing = [one for one in GROUPS[name] if not (context.product / one).exists()]
    if missing:
        raise Problem(f"{context.product} has no {', '.join(missing)}.")
    computer = context.computer("tests")
    left_out = [one for one in NOT_ON_WINDOWS if one.startswith(GROUPS[name])]
    arguments = ["-m", "pytest", "-m", "not data and not gpu and not web", *GROUPS[name]]
    return _run_tests(name, context, computer, [computer.tests_python, *arguments], context.product, left_out)


def test_addon(name: str, context: Context) -> str:
    """Run a group of tests in Blender as a module, with the installed zip, as `scripts/run_blender_tests.py` does."""
    computer = context.computer("blender")
    folder = computer.drive / "blender-tests"
    shutil.rmtree(folder, ignore_errors=True)
    # Copied, so that they cannot import from the checkout by mistake.
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(context.product / "tests" / "blender", folder / "tests", ignore=ignored)
    zip_file = shutil.copy(context.zip_file, folder)
    variables = {
        "GAUSSIAN_HERITAGE_ZIP": Path(zip_file), "GAUSSIAN_HERITAGE_SHARED": folder / "shared",
        "GAUSSIAN_HERITAGE_PYTHON": computer.tests_python,
        "GAUSSIAN_HERITAGE_DEMO": context.product / "demo",
        "GAUSSIAN_HERITAGE_FIXTURES": context.product / "tests" / "fixtures",
    }  # fmt: skip
    environment = {name: computer.windows(path) for name, path in variables.items()}
    if name in WITH_MODELS:
        _fetch_models(context, computer)
    files = IN_BLENDER[name]
    words = [computer.environment_python("blender"), "-P", "-m", "pytest", "-c", folder / "tests" / "pytest.ini"]
    words += [folder / "tests" / file for file in files]
    ids = [one.removeprefix(BLENDER) for one in NOT_ON_WINDOWS]
    left_out = [one for one in ids if one.startswith(files)]
    return _run_tests(f"add-on in Blender, {name}", context, computer, words, folder, left_out, environment)


def _fetch_models(context: Context, computer: Windows) -> None:
    """Fetch the model files of the user, as `make setup` does."""
    command = [computer.tests_python, "-m", "engine", "models", "fetch"]
    variables = {"PYTHONDONTWRITEBYTECODE": "1"}
    done = computer.run(command, cwd=context.product, timeout=_MAX_SECONDS, env=variables)
    if done.code:
        raise Problem(f"the model files were not fetched: {done.err.strip()[-300:]}")


def _run_tests(
    name: str, context: Context, computer: Windows, command: list[object], folder: Path, left_out: list[str],
    environment: Mapping[str, str] | None = None,
) -> str:  # fmt: skip
    """Run pytest and return the numbers; raise with the names of failed tests."""
    options = ["-v", "--tb=short", "-p", "no:cacheprovider", "-o", f"faulthandler_timeout={_MAX_SECONDS_OF_A_TEST}"]
    options += ["-o", "faulthandler_exit_on_timeout=true"]
    options += [word for one in left_out for word in ("--deselect", one)]
    variables = {"PYTHONDONTWRITEBYTECODE": "1", **(environment or {})}
    log = context.cache / "logs" / f"tests {name}.txt"
    log.parent.mkdir(exist_ok=True)
    done = computer.run([*command, *options], cwd=folder, timeout=_MAX_SECONDS, env=variables, log=log)
    if done.timed_out:
        raise Problem(f"no end within {_MAX_SECONDS:.0f} s; {told(done.out)}; output in {log.name}")
    if done.code:
        raise Problem(f"{told(done.out)}; output in {log.name}")
    return told(done.out) + (f"; {len(left_out)} left out" if left_out else "")


def told(output: str) -> str:
    """Return what pytest printed with ``-v``, in short: numbers, failed tests, and the test in which it was ended."""
    counts = re.findall(r"^=* ?(\d+ (?:passed|failed|errors?|skipped)\b.*?) in [\d.]+s", output, re.MULTILINE)
    results = []
    for line in re.findall(r"^\S+\.py::.* .*", output, re.MULTILINE):
        test, result = re.split(r"\s+(?=(?:PASSED|FAILED|ERROR|SKIPPED|XFAIL|XPASS)\b|$)", line, maxsplit=1)
        # Windows' pytest names files with backslashes.
        file, _, name = test.partition("::")
        results.append((f"{PureWindowsPath(file).name}::{name}", result))
    failures = [test for test, result in results if result.startswith(("FAILED", "ERROR"))]
    text = counts[-1] if counts else f"pytest was ended after {len(results)} tests, {len(failures)} failed"
    if not counts and results and not results[-1][1]:
        text += f", in {results[-1][0]}"
    more = f" and {len(failures) - _SHOWN_FAILURES} more" if len(failures) > _SHOWN_FAILURES else ""
    return text + (f": {', '.join(failures[:_SHOWN_FAILURES])}{more}" if failures else "")
