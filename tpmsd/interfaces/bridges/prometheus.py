"""`tpmsd bridge prometheus`: /metrics over HTTP, on the loopback unless told otherwise.

In: the status socket, asked once per scrape. Out: the metrics of `metrics`. The daemon is asked when
Prometheus asks, so nothing here can be stale.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.interfaces.bridges.metrics import families
from tpmsd.onboard.sinks.status_client import StatusError, read_status

SCRAPE_TIMEOUT_S = 3.0
"""Below the 10 s of Prometheus's own default."""


class StatusCollector:
    """What prometheus-client asks at each scrape."""

    def __init__(self, path: Path, log: logging.Logger) -> None:
        self._path, self._log = path, log
        self._said = ""

    def describe(self) -> list[Any]:
        """Nothing: so that registering asks no daemon."""
        return []

    def collect(self) -> Iterator[Any]:
        """The families of the moment."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        for family in families(self._document()):
            kind = CounterMetricFamily if family.kind == "counter" else GaugeMetricFamily
            metric = kind(family.name, family.help, labels=family.labels)
            for labels, value in family.samples:
                metric.add_metric(labels, value)
            yield metric

    def _document(self) -> dict[str, Any] | None:
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
    """Begin to serve; the port (of interest where 0 was asked for), and what ends it.

    Raises ConfigError where prometheus-client is not installed, TpmsdError where nobody can listen there.
    """
    try:
        from prometheus_client import CollectorRegistry, start_http_server
    except ImportError:
        raise ConfigError("prometheus-client is not installed: pip install 'tpmsd[prometheus]'") from None
    registry = CollectorRegistry(auto_describe=False)
    registry.register(StatusCollector(path, log))
    try:
        server, thread = start_http_server(port, addr=address, registry=registry)
    except OSError as error:
        raise TpmsdError(f"{address}:{port}: cannot listen: {error.strerror or error}") from None

    def end() -> None:
        server.shutdown()
        server.server_close()
        thread.join(2.0)

    return int(server.server_port), end
