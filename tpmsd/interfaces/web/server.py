"""The HTTP server of the pages: uvicorn with bounds of its own.

In: an ASGI application, settings, a bound socket. Out: a server to run. uvicorn bounds the headers' size (h11
does, httptools does not), but no time in which they must arrive: `timeout_keep_alive` begins with the first
answer, and any byte ends it. It counts connections for all visitors together, half-sent requests included,
and accepts up to its backlog in one turn of the event loop. So the listening socket counts
(`connections`), and the protocol says which of its connections wait.
"""

from __future__ import annotations

import socket
from typing import Any

import h11
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from tpmsd.interfaces.web.connections import Connections, Listener
from tpmsd.interfaces.web.settings import WebSettings


def make_server(
    app: ASGIApp, settings: WebSettings, certificate: str | None = None, key: str | None = None
) -> tuple[uvicorn.Server, Listener]:
    """Return the server and the socket on which it is to be run; OSError or SystemExit where it cannot be
    bound.
    """
    connections = Connections(settings)

    async def expire() -> None:
        connections.expire()

    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="asyncio",  # uvloop would not accept by the listener
        http=_protocol_class(connections),
        ws="none",
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        backlog=settings.accepted_at_once,
        h11_max_incomplete_event_size=settings.max_header_bytes,
        callback_notify=expire,
        timeout_notify=0,  # with every second that the server counts
        timeout_graceful_shutdown=2,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    listener = Listener(config.bind_socket(), connections)
    listener.listen()  # before the address is said: who is quick waits instead of being refused
    return uvicorn.Server(config), listener


def _protocol_class(connections: Connections) -> type[H11Protocol]:
    """Return an HTTP protocol class that reports to `connections` what each connection does."""

    class Protocol(H11Protocol):
        """HTTP/1.1 by h11; a request counts as there with the last byte of its body."""

        _address: tuple[Any, ...] = ("", 0)

        def connection_made(self, transport: Any) -> None:
            self._address = transport.get_extra_info("peername") or ("", 0)
            connections.attach(self._address, transport.abort)
            super().connection_made(transport)

        def handle_events(self) -> None:
            super().handle_events()
            answering = self.cycle is not None and not self.cycle.response_complete
            if answering and self.conn.their_state in (h11.DONE, h11.MUST_CLOSE):
                connections.mark_answering(self._address)

        def on_response_complete(self) -> None:
            connections.mark_waiting(self._address)
            super().on_response_complete()

        def pause_writing(self) -> None:
            connections.mark_stalled(self._address, True)
            super().pause_writing()

        def resume_writing(self) -> None:
            connections.mark_stalled(self._address, False)
            super().resume_writing()

    return Protocol


def port_of(listener: socket.socket) -> int:
    """Return the port on which a socket listens."""
    return int(listener.getsockname()[1])
