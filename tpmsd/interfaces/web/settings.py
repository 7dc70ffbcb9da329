"""What can be set of the web page, each with its unit and its reason."""

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
    """What a visitor must know; None: nothing, allowed on loopback alone."""
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
    """Of a request; the only one with a body is a reset."""
    niceness: int = 5
    """Added to that of the process: the daemon on the same machine is scheduled before its pages."""
