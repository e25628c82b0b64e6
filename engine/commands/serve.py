"""``serve``: the web page, on this computer or for a network."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..errors import EnvironmentProblem
from ..events import Emit, Finished, StopCheck

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

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
    parser.add_argument("--add-user", metavar="NAME", help="add a user, or give a user a new token; prints it once")
    parser.add_argument("--remove-user", metavar="NAME", help="remove a user; the user's projects stay")


def project_folder(options: argparse.Namespace) -> None:
    """Return None: the server has no project of its own."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Change the users, or serve."""
    try:
        from ..serve import Accounts, ServeSettings, run_server
    except ModuleNotFoundError as error:
        raise EnvironmentProblem(
            f"The package {error.name} is missing, which only the server needs. Use a checkout of the repository: "
            "`make serve` installs what it needs."
        ) from error
    settings = ServeSettings(data=options.data.absolute())
    if options.add_user is not None:
        token = Accounts(settings.data).add(options.add_user)
        emit(Finished(f"The token of {options.add_user}, shown only now: {token}", {"token": token}))
    elif options.remove_user is not None:
        Accounts(settings.data).remove(options.remove_user)
        emit(Finished(f"{options.remove_user} was removed; the projects stay."))
    else:
        run_server(replace(settings, port=options.port, lan=options.lan), emit, should_stop)
    return 0
