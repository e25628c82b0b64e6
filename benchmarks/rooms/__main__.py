"""The command line of the random rooms: ``python -m benchmarks.rooms COMMAND``.

example: python -m benchmarks.rooms run --draw "opaque scenes" --doc docs/segmentation.md
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from engine.cli.terminal import EventOutput
from engine.core.errors import Cancelled, DiskError, HeritageError, ProjectError, SettingsError
from engine.core.events import never_stop

from ..places import ROOT, python_of
from .draw_rows import read_rows
from .draws import CHOOSING_ROOMS, Draw, Room, draw_now, read_draws, rooms_of
from .repository import Repository
from .running import MeasuringRun
from .table import draws_section, rooms_section, write_tables


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for an error, 130 when it was stopped."""
    options = _parser().parse_args(arguments)
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        options.run(options)
    except KeyboardInterrupt:
        sys.stderr.write("Stopped. Run the same command again to continue.\n")
        return Cancelled.exit_code
    except Cancelled as error:
        sys.stderr.write(f"{error}\n")
        return Cancelled.exit_code
    except HeritageError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except OSError as error:
        problem = DiskError(f"{error.filename or ROOT} cannot be used: {error.strerror or error}. Check the disk.")
        sys.stderr.write(f"{problem}\n")
        return 1
    finally:
        signal.signal(signal.SIGTERM, before)
    return 0


def _interrupt(number: int, frame: object) -> NoReturn:
    raise KeyboardInterrupt


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.rooms", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="measure the rooms that have no result yet; a killed run is continued")
    run.add_argument("--draw", metavar="REASON", help="freeze the present commit and draw its test rooms")
    run.add_argument("--commit", help="measure the draw of this commit (default: the last draw)")
    run.add_argument(
        "--rooms", choices=("choosing", "test", "all", "models"), default="all", help="(default: %(default)s)"
    )
    run.add_argument(
        "--models", type=Path, metavar="FOLDER", help="with --rooms models: of *.sh3f files, see demo/random_rooms"
    )
    run.add_argument("--only", metavar="ROOM", help="only this room, e.g. room_3")
    run.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the tables into this file")
    run.set_defaults(run=_run)

    render = commands.add_parser("render", help="render choosing rooms into out/rooms, for other benchmarks")
    render.add_argument("rooms", nargs="+", choices=[room.name for room in CHOOSING_ROOMS], metavar="ROOM")
    render.set_defaults(run=_render)

    table = commands.add_parser("table", help="print the tables of the stored results")
    table.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the tables into this file")
    table.set_defaults(run=_table)

    reconstruct = commands.add_parser("reconstruct", help="reconstruct one room with the method of this working tree")
    reconstruct.add_argument("room", type=Path, help="folder with photos/ and cameras/")
    reconstruct.add_argument("--out", type=Path, required=True, help="project folder")
    reconstruct.set_defaults(run=_reconstruct)

    measure = commands.add_parser("measure", help="measure one project with the method of this working tree")
    measure.add_argument("project", type=Path)
    measure.add_argument("truth", type=Path, help="folder with the ground truth of the room")
    measure.add_argument("--out", type=Path, required=True, metavar="FILE.json")
    measure.set_defaults(run=_measure)

    keep = commands.add_parser("keep", help="pack the trained choosing rooms into demo/random_rooms/choosing")
    keep.add_argument("--commit", help="of the method that trained them (default: that of the last draw)")
    keep.add_argument("--only", metavar="ROOM", help="only this room, e.g. room_3")
    keep.set_defaults(run=_keep)

    unpack = commands.add_parser("unpack", help="unpack a kept choosing room")
    unpack.add_argument("room", choices=[room.name for room in CHOOSING_ROOMS])
    unpack.add_argument("--out", type=Path, required=True, help="new folder for photos, ground truth and project")
    unpack.set_defaults(run=_unpack)
    return parser


def _run(options: argparse.Namespace) -> None:
    repository = Repository(ROOT)
    if options.draw is not None and options.commit is not None:
        raise SettingsError("--draw freezes the present commit, and --commit names an earlier one. Give only one.")
    frozen = draw_now(repository, options.draw) if options.draw is not None else _draw_of(repository, options.commit)
    draws = read_draws(ROOT)
    rooms = _chosen(rooms_of(frozen, options.rooms), options.only)
    _measuring_run(repository, options.models).measure([frozen.commit], rooms)
    _show(draws, options.doc)


def _render(options: argparse.Namespace) -> None:
    _measuring_run(Repository(ROOT)).render([room for room in CHOOSING_ROOMS if room.name in options.rooms])


def _measuring_run(repository: Repository, models: Path | None = None) -> MeasuringRun:
    return MeasuringRun(repository, blender=str(python_of("blender-4.5")), engine=sys.executable, models=models)


def _table(options: argparse.Namespace) -> None:
    draws = read_draws(ROOT)
    if not draws:
        raise _nothing_drawn()
    _show(draws, options.doc)


def _show(draws: Sequence[Draw], document: Path | None) -> None:
    for section in (rooms_section(ROOT, draws), draws_section(read_rows(ROOT, draws))):
        sys.stdout.write(f"{section}\n\n")
    if document is not None:
        write_tables(document, ROOT, draws)


def _reconstruct(options: argparse.Namespace) -> None:
    from .reconstruction import reconstruct_room

    with contextlib.closing(EventOutput(json_lines=True, log=None)) as output:
        reconstruct_room(options.room, options.out, emit=output, should_stop=never_stop)


def _measure(options: argparse.Namespace) -> None:
    from .measuring import measure_project

    with contextlib.closing(EventOutput(json_lines=True, log=None)) as output:
        measure_project(options.project, options.truth, options.out, emit=output, should_stop=never_stop)


def _keep(options: argparse.Namespace) -> None:
    from .keeping import KEPT_FOLDER, pack_room

    repository = Repository(ROOT)
    draw = _draw_of(repository, options.commit)
    for room in _chosen(CHOOSING_ROOMS, options.only):
        size = pack_room(ROOT, room, draw.commit)
        sys.stderr.write(f"{KEPT_FOLDER / room.name}.tar.xz: {size / 1e6:.2f} MB\n")


def _unpack(options: argparse.Namespace) -> None:
    from .keeping import KEPT_FOLDER, unpack_room

    project = unpack_room(ROOT / KEPT_FOLDER / f"{options.room}.tar.xz", options.out)
    sys.stderr.write(f"The project is in {project}.\n")


def _draw_of(repository: Repository, commit: str | None) -> Draw:
    """Return the draw of a commit, by default the last one."""
    draws = read_draws(ROOT)
    if not draws:
        raise _nothing_drawn()
    if commit is None:
        return draws[-1]
    full = repository.full_commit(commit)
    found = next((draw for draw in draws if draw.commit == full), None)
    if found is None:
        known = ", ".join(draw.commit[:8] for draw in draws)
        raise SettingsError(f"The commit {full[:12]} has no test rooms, only {known}. Draw them with --draw REASON.")
    return found


def _nothing_drawn() -> ProjectError:
    return ProjectError("No method is frozen yet. Commit it, then run `make test-rooms DRAW=REASON`.")


def _chosen(rooms: Sequence[Room], only: str | None) -> Sequence[Room]:
    if only is None:
        return rooms
    found = [room for room in rooms if room.name == only]
    if not found:
        raise SettingsError(f"There is no room {only!r} here, only {', '.join(room.name for room in rooms)}.")
    return found


if __name__ == "__main__":
    sys.exit(main())
