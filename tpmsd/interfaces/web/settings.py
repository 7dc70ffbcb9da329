"""Settings of the web page, each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WebSettings:
    """Bounds of the server; the command line sets host, port and secrets."""

    host: str = "127.0.0.1"
    """Loopback: whoever is on the machine. Any other address needs a certificate and a token."""
    port: int = 8377
    """No service of IANA's registry has it."""
    token: str | None = None
    """Token that a visitor must present; None: nothing, allowed on loopback alone."""
    resets: bool = True
    """The page may ask the daemon for a reset. The command line sets it to False without a token, unless the
    status socket is open to all: such a page is open to every local user, whatever `[status] mode` says."""
    secure: bool = False
    """Served over TLS."""
    history_s: float = 4 * 3600.0
    """Span of the live timeline: the last hours, as a driver asks for them."""
    history_rows: int = 1800
    """Rows of the live timeline; one per 8 s of four hours, more than a screen has columns for."""
    max_streams: int = 256
    """Live connections at a time; each costs some 30 kB."""
    retry_s: float = 1.0
    """Wait before the daemon's socket is tried again."""
    silence_s: float = 10.0
    """Without an update for so long the daemon counts as gone; it sends one per second."""
    heartbeat_s: float = 15.0
    """A comment on an idle stream, so that proxies keep it."""
    max_points: int = 4000
    """Points of one series of a drive that are sent at most: two per column of a wide screen."""
    max_body_bytes: int = 4096
    """Size of a request's body at most; those with a body are a reset and a login."""
    max_header_bytes: int = 16384
    """Size of a request's line and headers: a browser sends 1 kB."""
    request_s: float = 10.0
    """From a connection, or from the last answer, to the end of a request: a browser takes milliseconds, a
    phone at the edge of its cell some seconds."""
    stalled_s: float = 60.0
    """A visitor that takes nothing of an answer for so long is gone: TCP tries again within seconds."""
    max_connections: int = 900
    """Connections of all visitors, live pages and requests: a process may have 1,024 files open by default.
    """
    max_connections_per_address: int = 600
    """Connections of one address. A proxy or a household stands for many visitors: 256 live pages may be its
    own while 300 more arrive, which are connected before they ask. Others keep 300 places.
    """
    accepted_at_once: int = 32
    """In one turn of the event loop: the first of a burst are answered before the last ones take places."""
    niceness: int = 5
    """Added to that of the process: the daemon on the same machine is scheduled before its pages."""
