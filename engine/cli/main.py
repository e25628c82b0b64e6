"""The command line, ``python -m engine COMMAND``: parses the arguments, runs one command and reports its errors."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..core.errors import Cancelled, DiskError, EnvironmentProblem, HeritageError, is_out_of_memory
from ..core.events import ErrorEvent, Event, Finished
from ..core.parts import measured_parts
from ..core.system import StopOnSignal, cpu_seconds, end_children_with_this_process, signals_held_back
from .commands import COMMANDS, load_command
from .terminal import EventOutput


def build_parser(names: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser of the commands of these names."""
    parser = argparse.ArgumentParser(
        prog="python -m engine",
        description="Photos in, Gaussians and separate objects out.",
        epilog='example: python -m engine reconstruct photos --out scene --prompts "vase, teapot"',
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in map(load_command, names):
        command = commands.add_parser(
            module.NAME,
            help=module.HELP,
            description=module.HELP,
            epilog=f"example: {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.add_argument("--events", action="store_true", help="progress as JSON lines on standard output")
        log_in, uses_cameras = getattr(module, "LOG_IN", ""), getattr(module, "USES_CAMERAS", False)
        command.set_defaults(run=module.run, log_in=log_in, uses_cameras=uses_cameras)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the name of the program; by default those of the process.
    """
    given = sys.argv[1:] if arguments is None else arguments
    # The threads of NumPy start when a command is imported, and must not take the signals.
    with signals_held_back():
        parser = build_parser([one for one in given[:1] if one in COMMANDS] or COMMANDS)
    options = parser.parse_args(given)
    project: Path | None = getattr(options, options.log_in, None)
    output = EventOutput(json_lines=options.events, log=project / "log.jsonl" if project else None)
    try:
        end_children_with_this_process()
        with measured_parts(cpu_seconds) as parts, StopOnSignal() as should_stop:
            if options.uses_cameras:
                # While pycolmap is imported, its handlers take the place of ours for some milliseconds. Here no other
                # thread can take a signal, see `__main__`.
                with signals_held_back():
                    from ..cameras import undistort  # noqa: F401

            def emit(event: Event) -> None:
                output(replace(event, parts=parts.as_json()) if isinstance(event, Finished) else event)

            code: int = options.run(options, emit, should_stop)
        return code
    except HeritageError as error:
        output(ErrorEvent(str(error), type(error).__name__))
        return error.exit_code
    except KeyboardInterrupt:
        output(ErrorEvent("Stopped. Run the same command again to continue.", Cancelled.__name__))
        return Cancelled.exit_code
    except Exception as error:
        output.write_log(traceback.format_exc())
        translated = _translate(error, project)
        output(ErrorEvent(str(translated), type(translated).__name__))
        return translated.exit_code
    finally:
        output.close()


def _translate(error: Exception, project: Path | None) -> HeritageError:
    """Return the error to report for an exception that no package translated."""
    if is_out_of_memory(error):
        return EnvironmentProblem("The memory of this machine is full. Choose a smaller preset or fewer photos.")
    if isinstance(error, ModuleNotFoundError):
        from .doctor import missing_package

        return missing_package(error.name)
    if isinstance(error, OSError) and error.strerror:
        which = error.filename or project or "A file"
        return DiskError(f"{which} cannot be used: {error.strerror}. Check the disk and permissions, then run again.")
    where = f" Details are in {project / 'log.jsonl'}." if project and (project / "log.jsonl").exists() else ""
    return HeritageError(f"An unexpected error occurred: {type(error).__name__}: {error}.{where}")
