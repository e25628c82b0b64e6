"""Runs the server until it is stopped, and says where it can be reached."""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Callable, Iterator

import uvicorn
from filelock import FileLock, Timeout

from ..core.errors import DiskError, EnvironmentProblem, ProjectError, SettingsError
from ..core.events import Emit, Finished, StopCheck
from .access import Server
from .accounts import Accounts
from .app import PAGE, create_app
from .certificate import certificate_files
from .connections import BACKLOG, Listener, Protocol
from .settings import ServeSettings

_LOCAL_HOSTS = ["127.0.0.1", "localhost"]
_SHUTDOWN_SECONDS = 5


def run_server(settings: ServeSettings, emit: Emit, should_stop: StopCheck) -> None:
    """Serve until `should_stop` is true.

    Raises
    ------
    EnvironmentProblem
        When the page was not built.
    SettingsError
        When the port is taken, or other computers shall connect and there is no user.
    ProjectError
        When another server works with the same data.
    """
    if not (PAGE / "index.html").is_file():
        raise EnvironmentProblem("The page of the server is not built. Run `make serve` once, which builds it.")
    if settings.lan and not Accounts(settings.data).names():
        raise SettingsError(
            f"Nobody could sign in to {settings.data}. Add a user first: --first-user NAME, added to this command, "
            "does it and shows the token."
        )
    with _only_server(settings), _listening(settings) as listener:
        port = listener.getsockname()[1]
        hosts = [*_LOCAL_HOSTS, *((settings.names or _own_addresses()) if settings.lan else [])]
        app = create_app(settings, hosts)
        server_of_app: Server = app.state.server
        listener.connections = server_of_app.connections
        config = uvicorn.Config(
            app,
            access_log=False,
            log_level="warning",
            server_header=False,
            # Whoever sends X-Forwarded-For could pass for another address, and for TLS.
            proxy_headers=False,
            backlog=BACKLOG,
            timeout_keep_alive=int(settings.header_seconds) + 1,
            timeout_graceful_shutdown=_SHUTDOWN_SECONDS,
            # Only such a loop lets the listener count connections, on all systems.
            loop="asyncio:SelectorEventLoop",
            http=Protocol,
            ws="none",
        )
        if settings.lan:
            certificate, key = certificate_files(settings.data, hosts)
            config.ssl_certfile, config.ssl_keyfile = str(certificate), str(key)
        server = _Server(config, should_stop, lambda: _announce(server_of_app, hosts, port, emit))
        server.run(sockets=[listener])
    job = "is continued by the next server" if settings.stop_jobs else "goes on, and the next server shows it"
    emit(Finished(f"The server has ended. A running job {job}."))


class _Server(uvicorn.Server):
    """A server that ends when `should_stop` says so, and tells when it is ready."""

    def __init__(self, config: uvicorn.Config, should_stop: StopCheck, on_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._should_stop = should_stop
        self._on_ready = on_ready

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the command line, which turns them into `should_stop`."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and say so."""
        await super().startup(sockets)
        if self.started:
            self._on_ready()

    async def on_tick(self, counter: int) -> bool:
        """End when it is wanted; called ten times a second."""
        if self._should_stop():
            self.should_exit = True
        return await super().on_tick(counter)


def _announce(server: Server, hosts: list[str], port: int, emit: Emit) -> None:
    settings = server.settings
    scheme = "https" if settings.lan else "http"
    host = hosts[-1] if settings.lan else hosts[0]
    address = f"{scheme}://{host}:{port}/"
    # Not `Progress`, whose messages are parts of a line: logs and terminals show these as they are.
    emit(Finished(f"Open {address} in a browser. Stop with Ctrl+C."))
    if settings.lan:
        import segno

        names = server.accounts.names()
        user = settings.first_user or names[0]
        whose = "For a phone in the same network"
        if user in names and (settings.first_user or len(names) == 1):
            # Behind #, where browsers keep it to themselves.
            address += f"#/sign-in/{server.accounts.new_code(user)}"
            whose += f", signed in as {user}: works once, in the next 15 minutes. Later: start the server again"
        text = io.StringIO()
        segno.make(address).terminal(text, compact=True)
        emit(Finished(f"{whose}.\n{text.getvalue()}"))
        if "#" in address:
            emit(Finished(f"The same as an address: {address}"))


@contextlib.contextmanager
def _only_server(settings: ServeSettings) -> Iterator[None]:
    """Hold the lock of the data folder, which the system releases even after SIGKILL."""
    try:
        settings.data.mkdir(parents=True, exist_ok=True)
        with FileLock(settings.data / "server.lock", blocking=False):
            yield
    except Timeout as error:
        raise ProjectError(f"Another server works with {settings.data}. Stop it, or choose another --data.") from error
    except OSError as error:
        raise DiskError(
            f"{settings.data} cannot be written: {error.strerror or error}. Choose another --data."
        ) from error


@contextlib.contextmanager
def _listening(settings: ServeSettings) -> Iterator[Listener]:
    host = "0.0.0.0" if settings.lan else settings.host  # noqa: S104 that is what --lan means
    with Listener() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, settings.port))
        except OSError as error:
            raise SettingsError(
                f"Port {settings.port} cannot be used: {error.strerror}. Choose another --port."
            ) from error
        listener.listen()
        listener.set_inheritable(False)
        yield listener


def _own_addresses() -> list[str]:
    """Return the names and addresses of this computer in its network, the one to be announced last."""
    name = socket.gethostname()
    found = {name, f"{name}.local"}
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        # Sends nothing: the system only chooses the address by which it would.
        probe.connect(("192.0.2.1", 9))
        return [*sorted(found), probe.getsockname()[0]]
    return sorted(found)
