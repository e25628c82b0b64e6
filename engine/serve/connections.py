"""Connections to the server: how many there may be, and which one ends to make room for another.

A connection without a request costs nothing to whoever opens it, so it never keeps anybody else out: a new connection
ends the one that has been without a request for longest. Connections are counted from the moment they are accepted,
before TLS.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import Counter, OrderedDict
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from .settings import ServeSettings

BACKLOG = 16
"""Connections that are accepted in a turn of the event loop. A request is read some turns after its connection was
accepted; few others are accepted meanwhile, so that it does not have to make room."""
_QUEUE = 4096
Peer = tuple[str, int]


class Connections:
    """The open connections of a server, by address and port of the client; used by the event loop alone."""

    def __init__(self, settings: ServeSettings) -> None:
        self._settings = settings
        self._open: dict[Peer, _Accepted] = {}
        self._of_address: Counter[str] = Counter()
        self._without_request: OrderedDict[Peer, None] = OrderedDict()
        """The one that has waited for longest first."""
        self._timers: dict[Peer, asyncio.TimerHandle] = {}

    def admit(self, connection: _Accepted) -> bool:
        """Count a new connection; return False where every other one has a request, so that there is no room."""
        address = connection.peer[0]
        if self._of_address[address] >= self._settings.max_address_connections and not self._end_one(address):
            return False
        if len(self._open) >= self._settings.max_connections and not self._end_one(self._busiest()):
            return False
        self._open[connection.peer] = connection
        self._of_address[address] += 1
        self.waits(connection.peer)
        return True

    def waits(self, peer: Peer) -> None:
        """Note that the head of a request is expected; the connection is ended when it does not arrive in time."""
        if peer not in self._open:
            return
        self._without_request[peer] = None
        self._without_request.move_to_end(peer)
        self._stop_timer(peer)
        loop = asyncio.get_running_loop()
        self._timers[peer] = loop.call_later(self._settings.header_seconds, self._end, peer)

    def receives(self, peer: Peer) -> None:
        """Note that the head of a request has arrived. Until it is whole or its user is known, it has no rights."""
        self._stop_timer(peer)

    def works(self, peer: Peer) -> None:
        """Note that a request has arrived or that its user is known: it is not ended for the sake of others."""
        self._stop_timer(peer)
        self._without_request.pop(peer, None)

    def closed(self, connection: _Accepted) -> None:
        """Forget a connection."""
        if self._open.get(connection.peer) is connection:
            self._forget(connection.peer)

    def _busiest(self) -> str:
        """Return the address with the most connections of which one can be ended."""
        addresses = {peer[0] for peer in self._without_request}
        return max(addresses, key=lambda address: self._of_address[address], default="")

    def _end_one(self, address: str) -> bool:
        peer = next((peer for peer in self._without_request if peer[0] == address), None)
        if peer is not None:
            self._end(peer)
        return peer is not None

    def _end(self, peer: Peer) -> None:
        connection = self._forget(peer)
        # The transport notices, and closes it.
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)

    def _forget(self, peer: Peer) -> _Accepted:
        self._stop_timer(peer)
        self._without_request.pop(peer, None)
        self._of_address[peer[0]] -= 1
        if not self._of_address[peer[0]]:
            del self._of_address[peer[0]]
        return self._open.pop(peer)

    def _stop_timer(self, peer: Peer) -> None:
        timer = self._timers.pop(peer, None)
        if timer is not None:
            timer.cancel()


class _Accepted(socket.socket):
    """An accepted connection, which says when it is closed."""

    peer: Peer
    connections: Connections | None = None

    def close(self) -> None:
        """Close it."""
        if self.connections is not None:
            self.connections.closed(self)
        super().close()


class Listener(socket.socket):
    """A listening socket that admits connections; an event loop with selectors calls `accept`."""

    connections: Connections | None = None

    def listen(self, backlog: int = _QUEUE) -> None:
        """Listen; the system keeps at least `_QUEUE` connections until they are accepted.

        An event loop gives the number that it accepts at a time. Where the queue is full, the system lets a client wait
        for seconds.
        """
        super().listen(max(backlog, _QUEUE))

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection for which there is room; others are closed at once.

        Raises
        ------
        BlockingIOError
            When no further one waits.
        """
        for _ in range(BACKLOG):
            plain, address = super().accept()
            accepted = _Accepted(plain.family, plain.type, plain.proto, fileno=plain.detach())
            if self.connections is None:
                return accepted, address
            accepted.peer = (str(address[0]), int(address[1]))
            if self.connections.admit(accepted):
                accepted.connections = self.connections
                return accepted, address
            accepted.close()
        raise BlockingIOError


class Protocol(H11Protocol):
    """HTTP/1.1 of uvicorn, which tells `Connections` what happens, and ends clients that do not read their answers."""

    _stalled: asyncio.TimerHandle | None = None

    def data_received(self, data: bytes) -> None:
        """Take bytes of a request."""
        super().data_received(data)
        self._note()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        if self._peer is not None:
            self._connections.waits(self._peer)
        super().on_response_complete()
        self._note()

    def pause_writing(self) -> None:
        """Wait for a client that does not read; not for ever."""
        super().pause_writing()
        seconds = self._connections_settings.read_seconds
        self._stalled = self.loop.call_later(seconds, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on writing."""
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
        super().resume_writing()

    @property
    def _peer(self) -> Peer | None:
        return None if self.client is None else (str(self.client[0]), int(self.client[1]))

    @property
    def _connections(self) -> Connections:
        found: Connections = self.config.app.state.server.connections  # type: ignore[union-attr]
        return found

    @property
    def _connections_settings(self) -> ServeSettings:
        found: ServeSettings = self.config.app.state.server.settings  # type: ignore[union-attr]
        return found

    def _note(self) -> None:
        cycle = self.cycle
        if self._peer is None or cycle is None or cycle.response_complete:
            return
        if cycle.more_body:
            self._connections.receives(self._peer)
        else:
            self._connections.works(self._peer)
