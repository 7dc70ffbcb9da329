"""A databroker for tests: kuksa.val.v2's service, made from the package's own protocol files.

It does what the KUKSA databroker documents for PublishValue, GetValue and Subscribe: paths it knows, values
of the signal's type or none, NOT_FOUND and INVALID_ARGUMENT for others, and a token where it was given one.
A value is stamped when it arrives. A subscriber gets what is known at once, then each value that is written,
the same one again too; for a slow one the oldest messages are dropped beyond its buffer.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
from kuksa.val.v2 import types_pb2, val_pb2, val_pb2_grpc

from tpmsd.interfaces.bridges.vss_names import IS_PRESSURE_LOW

PRESSURES = dict.fromkeys(IS_PRESSURE_LOW.values(), "bool")


class Databroker(val_pb2_grpc.VALServicer):
    """Values of signals, and how often each was written."""

    def __init__(self, types: Mapping[str, str] = PRESSURES, token: str = "") -> None:
        """`types`: path of each signal to its type, as the protocol names it."""
        self._types, self._token = dict(types), token
        self.values: dict[str, Any] = {}
        self.written: list[tuple[str, Any]] = []
        self.subscribers = 0
        self.ends_subscriptions = False
        self._points: dict[str, types_pb2.Datapoint] = {}
        self._queues: list[tuple[set[str], deque[dict[str, types_pb2.Datapoint]]]] = []
        self._changed = threading.Condition()

    def PublishValue(  # noqa: N802 -- gRPC's name
        self, request: val_pb2.PublishValueRequest, context: grpc.ServicerContext
    ) -> val_pb2.PublishValueResponse:
        self._check(request.signal_id.path, context)
        kind = request.data_point.value.WhichOneof("typed_value")
        right = kind in (None, self._types[request.signal_id.path])
        if not right or not request.data_point.HasField("timestamp"):
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, "Wrong type")
        self.write({request.signal_id.path: getattr(request.data_point.value, kind) if kind else None})
        return val_pb2.PublishValueResponse()

    def GetValue(  # noqa: N802
        self, request: val_pb2.GetValueRequest, context: grpc.ServicerContext
    ) -> val_pb2.GetValueResponse:
        self._check(request.signal_id.path, context)
        return val_pb2.GetValueResponse(data_point=self._points.get(request.signal_id.path))

    def Subscribe(  # noqa: N802
        self, request: val_pb2.SubscribeRequest, context: grpc.ServicerContext
    ) -> Iterator[val_pb2.SubscribeResponse]:
        for path in request.signal_paths:
            self._check(path, context)
        paths = set(request.signal_paths)
        queue: deque[dict[str, types_pb2.Datapoint]] = deque(maxlen=request.buffer_size + 1)
        empty = types_pb2.Datapoint()
        with self._changed:
            queue.append({path: self._points.get(path, empty) for path in paths})
            self._queues.append((paths, queue))
            self.subscribers += 1
        try:
            while context.is_active() and not self.ends_subscriptions:
                with self._changed:
                    self._changed.wait_for(lambda: queue, 0.1)
                while queue:
                    yield val_pb2.SubscribeResponse(entries=queue.popleft())
        finally:
            with self._changed:
                self._queues.remove((paths, queue))
                self.subscribers -= 1

    def write(self, values: Mapping[str, Any], stamp_s: float | None = None) -> None:
        """Take values, one message to each subscriber for all of them; the types are not looked at."""
        points = {}
        for path, value in values.items():
            point = types_pb2.Datapoint()
            if stamp_s is None:
                point.timestamp.GetCurrentTime()
            else:
                point.timestamp.FromNanoseconds(round(stamp_s * 1e9))
            if value is not None:
                setattr(point.value, self._types[path], value)
            points[path] = point
        with self._changed:
            self.values |= values
            self.written += values.items()
            self._points |= points
            for paths, queue in self._queues:
                if wanted := {path: point for path, point in points.items() if path in paths}:
                    queue.append(wanted)
            self._changed.notify_all()

    def by_wheel(self) -> list[bool | None]:
        """Whether the pressure is low: fl fr rl rr."""
        return [self.values.get(path) for path in IS_PRESSURE_LOW.values()]

    def _check(self, path: str, context: grpc.ServicerContext) -> None:
        if self._token and ("authorization", f"Bearer {self._token}") not in context.invocation_metadata():
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "no token")
        if path not in self._types:
            context.abort(grpc.StatusCode.NOT_FOUND, "Path not found")


@contextlib.contextmanager
def databroker(broker: Databroker, port: int = 0, tls: grpc.ServerCredentials | None = None) -> Iterator[int]:
    """Its port of the loopback, while it serves."""
    server = grpc.server(ThreadPoolExecutor(8), options=[("grpc.so_reuseport", 0)])
    val_pb2_grpc.add_VALServicer_to_server(broker, server)
    address = f"localhost:{port}"
    bound = server.add_insecure_port(address) if tls is None else server.add_secure_port(address, tls)
    server.start()
    try:
        yield bound
    finally:
        server.stop(None).wait()
