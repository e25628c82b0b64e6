"""``python -m engine.install.environment COMMAND``: install or remove the engine, or make an offline bundle.

example: python -m engine.install.environment install --folder ~/heritage-engine
         python -m engine.install.environment bundle dist/bundle.zip
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ...core.errors import Cancelled, HeritageError
from ...core.events import Emit, ErrorEvent, Event, Finished, Progress, StopCheck, Warned, to_json_line
from ...core.system import SYSTEMS, StopOnSignal, end_children_with_this_process, json_printable, printable
from .environment import EngineEnvironment, default_folder


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m engine.install.environment",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    install = commands.add_parser("install", help="install, repair or update the engine's Python environment")
    install.add_argument("--folder", type=Path, default=default_folder(), help="(default: %(default)s)")
    install.add_argument(
        "--python", type=Path, action="append", default=[], help="Python to try first; may be repeated"
    )
    install.add_argument("--torch", choices=("auto", "cpu", "cuda"), default="auto", help="(default: %(default)s)")
    install.add_argument("--bundle", type=Path, metavar="FILE.zip", help="offline bundle to install from")
    install.set_defaults(run=_install)
    remove = commands.add_parser("remove", help="delete it")
    remove.add_argument("--folder", type=Path, default=default_folder(), help="(default: %(default)s)")
    remove.set_defaults(run=_remove)
    bundle = commands.add_parser("bundle", help="write an offline bundle for this kind of computer or another")
    bundle.add_argument("out", type=Path, metavar="FILE.zip")
    bundle.add_argument("--system", choices=tuple(SYSTEMS), help="what it is for (default: computers like this one)")
    bundle.add_argument("--python-version", metavar="3.N", help="Python that it is for (default: that of --python)")
    bundle.add_argument("--python", type=Path, default=Path(sys.executable), help="(default: %(default)s)")
    bundle.add_argument("--torch", choices=("cpu", "cuda"), default="cpu", help="(default: %(default)s)")
    bundle.set_defaults(run=_bundle)
    for command in (install, remove, bundle):
        command.add_argument("--events", action="store_true", help="progress as JSON lines on standard output")
    options = parser.parse_args(arguments)
    emit: Emit = _print_json if options.events else _print_text
    try:
        end_children_with_this_process()
        with StopOnSignal() as should_stop:
            options.run(options, emit, should_stop)
    except HeritageError as error:
        emit(ErrorEvent(str(error), type(error).__name__))
        return error.exit_code
    except KeyboardInterrupt:
        emit(ErrorEvent("Stopped. Run the same command again to continue.", Cancelled.__name__))
        return Cancelled.exit_code
    return 0


def _install(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> None:
    from .installer import install

    install(
        EngineEnvironment(options.folder.absolute()), pythons=options.python, build=options.torch,
        bundle=options.bundle, emit=emit, should_stop=should_stop,
    )  # fmt: skip


def _remove(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> None:
    environment = EngineEnvironment(options.folder.absolute())
    emit(Progress("remove", 0.0, message=f"Deleting {environment.folder}"))
    environment.remove()
    emit(Finished(f"{environment.folder} was deleted."))


def _bundle(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> None:
    from ..models import models_folder
    from .bundle import write_bundle

    bundle = write_bundle(
        options.out.absolute(), options.python, models_folder(), options.torch, emit,
        system=SYSTEMS[options.system] if options.system else None, version=options.python_version,
    )  # fmt: skip
    size = bundle.file.stat().st_size / 1e6
    emit(Finished(f"{bundle.file}: {size:.0f} MB, for {bundle.platform} with Python {bundle.python}"))


def _print_json(event: Event) -> None:
    print(json_printable(to_json_line(event), sys.stdout), flush=True)


_last = ""


def _print_text(event: Event) -> None:
    """Print each new message once."""
    global _last
    message = getattr(event, "message", "")
    if message and message != _last and isinstance(event, (Progress, Warned, ErrorEvent, Finished)):
        _last = message
        where = sys.stdout if isinstance(event, Finished) else sys.stderr
        line = f"Error: {message}" if isinstance(event, ErrorEvent) else message
        print(printable(line, where), file=where, flush=True)


if __name__ == "__main__":
    sys.exit(main())
