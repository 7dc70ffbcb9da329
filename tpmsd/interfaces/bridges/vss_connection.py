"""A connection to a KUKSA databroker (gRPC, kuksa.val.v2), for both directions.

In: where it is, and how it is spoken to. Out: the calls of its service with their messages. Nothing is sent
before the first call; gRPC connects again by itself.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError

CALL_S = 2.0
"""Time that the databroker may take for one answer, s."""
RETRY_S = 1.0
"""Time from a failure to the next attempt, s."""
CHANNEL = (
    ("grpc.initial_reconnect_backoff_ms", 200),
    ("grpc.max_reconnect_backoff_ms", 5000),
    ("grpc.enable_http_proxy", 0),
)
"""gRPC's own waits would be two minutes; a databroker is not behind a web proxy."""


@dataclass(frozen=True, slots=True)
class DatabrokerSettings:
    """Address and credentials of the databroker."""

    host: str
    port: int
    ca: Path | None = None
    """TLS with this authority (PEM)."""
    token: str | None = None
    """JSON Web Token, where the databroker asks for one."""


class DatabrokerConnection:
    """The service `VAL` of one databroker."""

    def __init__(self, settings: DatabrokerSettings) -> None:
        """ConfigError where kuksa-client is not installed or the authority cannot be read."""
        os.environ.setdefault("GRPC_VERBOSITY", "ERROR")  # its own lines of a connection that ends
        try:
            import grpc
            from kuksa.val.v2 import types_pb2, val_pb2, val_pb2_grpc
        except ImportError:
            raise ConfigError("kuksa-client is not installed: pip install 'tpmsd[vss]'") from None
        self.types: Any = types_pb2
        self.requests: Any = val_pb2
        self.error: type[Exception] = grpc.RpcError
        """Raised by a call that failed; `failure` names the reason."""
        target = f"{settings.host}:{settings.port}"
        if settings.ca is None:
            self._channel = grpc.insecure_channel(target, options=CHANNEL)
        else:
            try:
                credentials = grpc.ssl_channel_credentials(settings.ca.read_bytes())
            except OSError as error:
                raise ConfigError(f"{settings.ca}: {error.strerror or error}") from None
            self._channel = grpc.secure_channel(target, credentials, options=CHANNEL)
        self._stub: Any = val_pb2_grpc.VALStub(self._channel)
        self._header = [] if settings.token is None else [("authorization", f"Bearer {settings.token}")]

    def call(self, name: str, request: Any) -> Any:
        """Return the response of one unary call of the service, such as `PublishValue`; raises `error`."""
        return getattr(self._stub, name)(request, timeout=CALL_S, metadata=self._header)

    def stream(self, name: str, request: Any) -> Any:
        """Return the iterator of responses of a streaming call; it has `cancel`."""
        return getattr(self._stub, name)(request, metadata=self._header)

    @staticmethod
    def failure(error: Any) -> str:
        """Return the name of the gRPC status: `not_found`, `unavailable`, `unauthenticated` and so on."""
        return str(error.code().name).lower()

    def close(self) -> None:
        """End all calls."""
        self._channel.close()
