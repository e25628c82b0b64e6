"""``python -m engine``: the command line."""

import os
import sys

# Torch's OpenMP threads spin at barriers; beside our own threads on few cores that made a step eight times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def start() -> int:
    """Run the command line; a Python that cannot even load it is told in a sentence what it lacks."""
    if sys.version_info < (3, 11):  # noqa: UP036 the Python that is asked may be any
        print(f"Error: {sys.executable} is too old: the engine needs Python 3.11 or newer.", file=sys.stderr)
        return 1
    try:
        from .cli import main
    except ModuleNotFoundError as error:
        from .doctor import missing_package

        print(f"Error: {missing_package(error.name)}", file=sys.stderr)
        return 1
    return main()


if __name__ == "__main__":
    try:
        sys.exit(start())
    except KeyboardInterrupt:
        # Before the first command began, or the person's second Ctrl-C while the last one ended.
        sys.exit(130)
