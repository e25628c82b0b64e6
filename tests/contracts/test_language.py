"""Words that were retired stay retired: one plain term for one thing, in code, messages and documents."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

RETIRED = {
    r"\bcorridors?\b": "pipeline",
    r"\b(house|room) rules\b|\bthis house\b|\bof the house\b|\bmake house\b|\bcheck_house\b": "repository, contracts",
    r"\b(side|later|earlier|cameras|photos|masks) rooms?\b|\brooms take\b|\broom's (own )?settings\b": "package",
    r"\bfront door\b|\bonly door\b|\bone door\b": "entry point, module",
    r"\bpassers?[-_ ]by\b": "transients",
    r"\btold as (not )?found\b|\btold apart\b": "not found, separated",
    r"\bfind_seeds\b|\bseed masks?\b|\bSeedKind\b": "mask evidence",
    r"\bthe person\b": "the user",
}  # fmt: skip
"""Pattern: what to say instead."""

ALLOWED = {
    "CHANGELOG.md",  # names what was renamed
    "tests/contracts/test_language.py",
    "tests/engine/training/test_settings.py",  # an old name of a setting
}


def texts() -> list[Path]:
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\0")  # fmt: skip
    kept = [name for name in names if Path(name).suffix in {".py", ".md", ".toml", ".yaml"} and name not in ALLOWED]
    return [ROOT / name for name in kept if "fixtures" not in name and (ROOT / name).is_file()]


@pytest.mark.parametrize("pattern", RETIRED)
def test_retired_word_is_not_used(pattern: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}"
        for path in texts()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(pattern, line, re.IGNORECASE) and "stored_as" not in line and "values.pop" not in line
    ]
    assert found == [], f"say {RETIRED[pattern]}"
