"""``serve``: the web page, on this computer or for a network."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import EnvironmentProblem
from ...core.events import Emit, Finished, StopCheck
from .scene_options import add_device_option

if TYPE_CHECKING:
    from ...serve import Accounts

NAME = "serve"
HELP = "Serve the web page: photos are uploaded in a browser, reconstructed here, and leave as objects."
EXAMPLE = "python -m engine serve --data scans --lan"
_PORT = 8765


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument(
        "--data", type=Path, default=Path("heritage_server"), help="folder of all projects (default: %(default)s)"
    )
    parser.add_argument(
        "--port", type=int, default=_PORT, help="port to listen on; 0: a free one (default: %(default)s)"
    )
    parser.add_argument(
        "--lan",
        action="store_true",
        help="let other computers and phones of the network connect, with TLS; users sign in with a token",
    )
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="HOST",
        help="with --lan: name or address by which browsers reach this server, where it is not this computer's own, as "
        "in a container; may be repeated",
    )
    parser.add_argument(
        "--first-user",
        metavar="NAME",
        help="add this user if there is none, and print the token once; with --lan, the QR code signs this user in",
    )
    parser.add_argument(
        "--stop-jobs",
        action="store_true",
        help="when the server is stopped, stop the running job too; the next server continues it (for containers)",
    )
    parser.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="do the jobs on the workers of this Dask cluster, which share the data folder; default: here, one by one",
    )
    add_device_option(parser, "train and to render objects")
    parser.add_argument(
        "--fetch-models",
        action=argparse.BooleanOptionalAction,
        help="let users have the model that knows any word fetched to this computer (default: not with --lan, where "
        "the owner does it: `models fetch`)",
    )
    parser.add_argument("--check", action="store_true", help="say whether the server on this port answers")
    parser.add_argument("--add-user", metavar="NAME", help="add a user, or give a user a new token; prints it once")
    parser.add_argument("--remove-user", metavar="NAME", help="remove a user; the user's projects stay")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Change the users, or serve."""
    from ...serve import ServeSettings, check_server

    settings = ServeSettings(
        data=options.data.absolute(), port=options.port, lan=options.lan, names=tuple(options.name),
        first_user=options.first_user or "", stop_jobs=options.stop_jobs, scheduler=options.scheduler,
        device=options.device, fetch_models=options.fetch_models,
    )  # fmt: skip
    if options.check:
        check_server(settings)
        emit(Finished("The server answers."))
        return 0
    try:
        from ...serve import Accounts, run_server
    except ModuleNotFoundError as error:
        raise EnvironmentProblem(
            f"The package {error.name} is missing, which only the server needs. Use a checkout of the repository: "
            "`make serve` installs what it needs."
        ) from error
    if options.add_user is not None:
        token = Accounts(settings.data).add(options.add_user)
        emit(Finished(f"The token of {options.add_user}, shown only now: {token}", {"token": token}))
    elif options.remove_user is not None:
        Accounts(settings.data).remove(options.remove_user)
        emit(Finished(f"{options.remove_user} was removed; the projects stay."))
    else:
        if settings.scheduler and importlib.util.find_spec("distributed") is None:
            raise EnvironmentProblem(
                "The package distributed is missing, which --scheduler needs. Install requirements/batch.txt with pip."
            )
        if options.first_user is not None:
            _add_first_user(Accounts(settings.data), options.first_user, emit)
        run_server(settings, emit, should_stop)
    return 0


def _add_first_user(accounts: Accounts, name: str, emit: Emit) -> None:
    """Add a user where there is none, and say the token."""
    if not accounts.names():
        token = accounts.add(name)
        emit(Finished(f"The token of {name}, shown only now: {token}"))
