"""``python -m engine``: the command line."""

import os
import signal
import sys

# Torch's OpenMP threads must sleep at barriers: with our own threads on few cores, spinning made a step 8 times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def start() -> int:
    """Run the command line; where it cannot be imported, print what this Python lacks."""
    if sys.version_info < (3, 11):  # noqa: UP036 users may choose any Python
        print(f"Error: {sys.executable} is too old: the engine needs Python 3.11 or newer.", file=sys.stderr)
        return 1
    from .core.system import signals_held_back

    try:
        # The threads of NumPy start here, and must not take the signals of the main thread; see `cli`.
        with signals_held_back():
            from .cli.main import main
        return main()
    except ModuleNotFoundError as error:
        from .cli.doctor import missing_package

        print(f"Error: {missing_package(error.name)}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    try:
        code = start()
        # The command is finished: a signal while Python ends must not change its exit code.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        sys.exit(code)
    except KeyboardInterrupt:
        # Before the command began, or a second Ctrl-C while it ended.
        sys.exit(130)
