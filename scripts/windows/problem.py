"""What the scripts of Windows' Python raise, and how they run programs."""

from __future__ import annotations

import os
import subprocess


class Problem(Exception):
    """Something that is not as it should be, as a sentence."""


def run(*words: object) -> str:
    """Run a program of this computer and return what it prints; raise when it fails."""
    command = [str(word) for word in words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "LC_ALL": "C.UTF-8"})
    if done.returncode:
        said = " ".join(f"{done.stdout[-700:]} {done.stderr[-1500:]}".split())
        raise Problem(f"{' '.join(command)[:200]} failed: {said}")
    return done.stdout
