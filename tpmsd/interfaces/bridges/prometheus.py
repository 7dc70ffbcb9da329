"""`tpmsd bridge prometheus`: /metrics over HTTP, on the loopback unless configured otherwise.

In: the status socket, asked once per scrape. Out: the metrics of `metrics`, which names them. The daemon is
asked when Prometheus asks, so nothing here can be stale.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.interfaces.bridges.metrics import families
from tpmsd.onboard.sinks.status_client import StatusError, read_status

SCRAPE_TIMEOUT_S = 3.0
"""Time-out of a scrape, s; below the 10 s of Prometheus's own default."""
MAX_REQUESTS = 16
"""Requests at a time, a thread each: a server or two scrape, every some seconds."""
WAITING = 64
"""Connections that the system holds until they are accepted; one beyond tries again after a second only."""
REQUEST_S = 10.0
"""Time from a connection to the end of its answer, s; what takes longer is closed, a scrape ends by itself
before."""


class StatusCollector:
    """Return the metrics; prometheus-client calls this at each scrape."""

    def __init__(self, path: Path, log: logging.Logger) -> None:
        self._path, self._log = path, log
        self._said = ""

    def describe(self) -> list[Any]:
        """Return no metrics, so that registering does not ask the daemon."""
        return []

    def collect(self) -> Iterator[Any]:
        """Yield the metric families of the latest status document."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        for family in families(self._read_document()):
            kind = CounterMetricFamily if family.kind == "counter" else GaugeMetricFamily
            metric = kind(family.name, family.help, labels=family.labels)
            for labels, value in family.samples:
                metric.add_metric(labels, value)
            yield metric

    def _read_document(self) -> dict[str, Any] | None:
        try:
            document = read_status(self._path, SCRAPE_TIMEOUT_S)
        except StatusError as error:
            if str(error) != self._said:
                self._log.warning("%s", error)
            self._said = str(error)
            return None
        self._said = ""
        return document


def serve(path: Path, address: str, port: int, log: logging.Logger) -> tuple[int, Callable[[], None]]:
    """Start the server; return its port (chosen by the system for 0) and a function that stops it.

    Raises ConfigError where prometheus-client is not installed, TpmsdError where nobody can listen there.
    """
    try:
        from prometheus_client import CollectorRegistry, make_wsgi_app
    except ImportError:
        raise ConfigError("prometheus-client is not installed: pip install 'tpmsd[prometheus]'") from None
    registry = CollectorRegistry(auto_describe=False)
    registry.register(StatusCollector(path, log))
    try:
        family, *_, where = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
        server = _Server(family, (str(where[0]), int(where[1])))
    except OSError as error:
        raise TpmsdError(f"{address}:{port}: cannot listen: {error.strerror or error}") from None
    server.set_app(make_wsgi_app(registry))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()

    def end() -> None:
        """Stop the server and its thread."""
        server.shutdown()
        server.server_close()
        thread.join(2.0)

    return int(server.server_port), end


class _Handler(WSGIRequestHandler):
    """Logs no request."""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Log nothing."""


class _Server(ThreadingMixIn, WSGIServer):
    """Server with a thread per request: a bounded number, each for a bounded time (prometheus-client's has no
    bounds)."""

    daemon_threads = True
    request_queue_size = WAITING

    def __init__(self, family: int, where: tuple[str, int]) -> None:
        self.address_family = family
        self._slots = threading.BoundedSemaphore(MAX_REQUESTS)
        super().__init__(where, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a request, or close the connection where all slots are taken."""
        if not self._slots.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread to be had
            self._slots.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer a request; close the connection of a visitor that is not done in time."""
        late = threading.Timer(REQUEST_S, _shut_down_socket, (request,))
        late.daemon = True
        late.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            late.cancel()
            self._slots.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log nothing: a visitor that leaves is no error."""


def _shut_down_socket(request: socket.socket) -> None:
    with contextlib.suppress(OSError):
        request.shutdown(socket.SHUT_RDWR)
