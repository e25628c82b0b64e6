"""The project's own tests, run by Windows' pytest."""

from __future__ import annotations

import dataclasses
import functools
import re
from pathlib import Path

from .launch import CODE_PAGES, USER
from .linux_only import GROUPS, NOT_ON_WINDOWS, QUICK
from .problem import Problem
from .steps import Context, Step

__all__ = ["test_steps"]

_MAX_SECONDS = 1800.0
_MAX_SECONDS_OF_A_TEST = 240
_SHOWN_FAILURES = 12


def test_steps(*, quick: bool) -> list[Step]:
    """Return a step for each group of tests; `quick`: only those of `QUICK`."""
    names = QUICK if quick else tuple(GROUPS)
    computer = Step("the computer itself", check_computer)
    return [computer, *(Step(f"tests: {name}", functools.partial(_run_group, name)) for name in names)]


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
    arguments = ["-m", "pytest", "-q", "--tb=line", "-p", "no:cacheprovider", "-m", "not data and not gpu and not web"]
    arguments += ["-o", f"faulthandler_timeout={_MAX_SECONDS_OF_A_TEST}", "-o", "faulthandler_exit_on_timeout=true"]
    arguments += [word for one in left_out for word in ("--deselect", one)]
    done = computer.run(
        [computer.tests_python, *arguments, *GROUPS[name]], cwd=context.product, timeout=_MAX_SECONDS,
        env={"PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    log = context.cache / "logs" / f"tests {name}.txt"
    log.parent.mkdir(exist_ok=True)
    log.write_text(f"{done.out}\n{done.err}", encoding="utf-8")
    counts = re.findall(r"^.*\b\d+ (?:passed|failed|errors?|skipped)\b.*$", done.out, re.MULTILINE)
    if done.timed_out:
        raise Problem(f"no end within {_MAX_SECONDS:.0f} s; output in {log}")
    failures = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.out, re.MULTILINE)
    if failures or done.code:
        more = f" and {len(failures) - _SHOWN_FAILURES} more" if len(failures) > _SHOWN_FAILURES else ""
        names = ", ".join(one.rpartition("/")[2] for one in failures[:_SHOWN_FAILURES])
        last = counts[-1] if counts else f"pytest ended with code {done.code}"
        raise Problem(f"{last}: {names}{more}; output in {log}")
    return re.sub(r" in [\d.]+s.*", "", counts[-1]) + (f"; {len(left_out)} left out" if left_out else "")
