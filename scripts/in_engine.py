"""Run a module with the Python of the engine's environment, for the hooks of .pre-commit-config.yaml.

example: python scripts/in_engine.py ruff check
"""

from __future__ import annotations

import subprocess
import sys

from places import python_of

if __name__ == "__main__":
    command = [str(python_of("engine")), "-m", *sys.argv[1:]]
    if not python_of("engine").exists():
        sys.exit(f"{command[0]} is missing. Run `make setup` first.")
    sys.exit(subprocess.run(command, check=False).returncode)
