"""A databroker for tests: kuksa.val.v2's service, made from the package's own protocol files.

It does what the KUKSA databroker documents for PublishValue and GetValue: paths it knows, values of the
signal's type or none, NOT_FOUND and INVALID_ARGUMENT for others, and a token where it was given one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import grpc
from kuksa.val.v2 import types_pb2, val_pb2, val_pb2_grpc

from tpmsd.bridges.vss_names import IS_PRESSURE_LOW


class Databroker(val_pb2_grpc.VALServicer):
    """Values of boolean signals, and how often each was written."""

    def __init__(self, paths: tuple[str, ...] = tuple(IS_PRESSURE_LOW.values()), token: str = "") -> None:
        self._paths, self._token = set(paths), token
        self.values: dict[str, bool | None] = {}
        self.written: list[tuple[str, bool | None]] = []

    def PublishValue(  # noqa: N802 -- gRPC's name
        self, request: val_pb2.PublishValueRequest, context: grpc.ServicerContext
    ) -> val_pb2.PublishValueResponse:
        if self._token and ("authorization", f"Bearer {self._token}") not in context.invocation_metadata():
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "no token")
        if request.signal_id.path not in self._paths:
            context.abort(grpc.StatusCode.NOT_FOUND, "Path not found")
        value = request.data_point.value.WhichOneof("typed_value")
        if value not in (None, "bool") or not request.data_point.HasField("timestamp"):
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, "Wrong type")
        low = request.data_point.value.bool if value else None
        self.values[request.signal_id.path] = low
        self.written.append((request.signal_id.path, low))
        return val_pb2.PublishValueResponse()

    def GetValue(  # noqa: N802
        self, request: val_pb2.GetValueRequest, context: grpc.ServicerContext
    ) -> val_pb2.GetValueResponse:
        point = types_pb2.Datapoint()
        if (low := self.values.get(request.signal_id.path)) is not None:
            point.value.bool = low
        return val_pb2.GetValueResponse(data_point=point)

    def by_wheel(self) -> list[bool | None]:
        """fl fr rl rr."""
        return [self.values.get(path) for path in IS_PRESSURE_LOW.values()]


@contextlib.contextmanager
def databroker(broker: Databroker, port: int = 0, tls: grpc.ServerCredentials | None = None) -> Iterator[int]:
    """Its port of the loopback, while it serves."""
    server = grpc.server(ThreadPoolExecutor(2), options=[("grpc.so_reuseport", 0)])
    val_pb2_grpc.add_VALServicer_to_server(broker, server)
    address = f"localhost:{port}"
    bound = server.add_insecure_port(address) if tls is None else server.add_secure_port(address, tls)
    server.start()
    try:
        yield bound
    finally:
        server.stop(None).wait()
