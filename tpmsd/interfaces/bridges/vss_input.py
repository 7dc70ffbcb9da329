"""`tpmsd bridge vss --input`: wheel speeds and position of a KUKSA databroker, onto a virtual CAN bus.

In: data points of the signals in `vss.dbc` (gRPC, kuksa.val.v2, Subscribe). Out: a frame for each value that
is renewed, at once. The daemon reads that bus as any other, and waits for no network. What waits is at the
databroker, `BUFFER` messages at most, of which it drops the oldest; what was held up is not sent
(`vss_frames.py`).
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from tpmsd.interfaces.bridges.can_wire import CanWire
from tpmsd.interfaces.bridges.vss_connection import RETRY_S, DatabrokerConnection, DatabrokerSettings
from tpmsd.interfaces.bridges.vss_frames import NotSent, VssFrame, VssFrames
from tpmsd.interfaces.bridges.vss_names import is_wheel

BUFFER = 200
"""Messages that the databroker keeps for a slow reader: a second of four wheels at 50 Hz."""
SILENCE_S = 10.0
"""Time without a value after which the subscription is made again, s: a connection may be dead without an
error."""
ORDINARY = frozenset({NotSent.NO_VALUE, NotSent.NOT_RENEWED})
"""Reasons that say nothing against a value."""


class VssInput:
    """Bridge from the VSS signals of one databroker to frames on one CAN bus."""

    def __init__(self, settings: DatabrokerSettings, wire: CanWire, log: logging.Logger) -> None:
        """ConfigError as `DatabrokerConnection` has it."""
        self._databroker, self._wire, self._log = DatabrokerConnection(settings), wire, log
        self._frames = VssFrames()
        self._absent: list[str] = []
        self._logged: set[tuple[str, NotSent]] = set()
        self._said = ""
        self.counts: Counter[str] = Counter()
        """Values that were sent, those for which the bus was away, and those of each `NotSent`."""

    def run(self) -> None:
        """Send values to the bus until an exception, such as that of a signal, ends it."""
        try:
            while True:
                self._wire.open()
                self.listen()
                time.sleep(RETRY_S)
        finally:
            self._databroker.close()
            self._wire.close()
            self._log.info("%s", ", ".join(f"{count} {name}" for name, count in self.counts.items()))

    def listen(self) -> None:
        """Subscribe, and send values until the databroker ends the call or is silent."""
        try:
            paths = self._available_paths()
            if any(map(is_wheel, paths)):
                self._forward_all(paths)
            else:
                self._warn_once("the databroker has no wheel speed")
        except self._databroker.error as error:
            reason = self._databroker.failure(error)
            if reason == "cancelled":  # by us
                reason = f"silent for {SILENCE_S:g} s"
            self._warn_once(f"the databroker gives no values ({reason})")

    def _available_paths(self) -> list[str]:
        """Return the signals that the databroker has and lets us read."""
        known, absent = [], []
        types, requests = self._databroker.types, self._databroker.requests
        for path in self._frames.paths:
            try:
                self._databroker.call(
                    "GetValue", requests.GetValueRequest(signal_id=types.SignalID(path=path))
                )
                known.append(path)
            except self._databroker.error as error:
                if self._databroker.failure(error) not in ("not_found", "permission_denied"):
                    raise
                absent.append(path)
        if absent != self._absent:
            self._log.info("not at the databroker, or not ours to read: %s", ", ".join(absent))
            self._absent = absent
        return known

    def _forward_all(self, paths: list[str]) -> None:
        request = self._databroker.requests.SubscribeRequest(signal_paths=paths, buffer_size=BUFFER)
        call = self._databroker.stream("Subscribe", request)
        with cancelled_by_silence(call, SILENCE_S) as received:
            for number, response in enumerate(call):
                received()
                if self._said:
                    self._log.info("the databroker gives values")
                    self._said = ""
                for path, point in response.entries.items():
                    if number == 0:  # what it knew before we asked, of whatever age
                        self._frames.note(path, stamp_s(point))
                    elif path in self._frames.paths:
                        self._forward(path, point)
        self._warn_once("the databroker gives no values (it has ended the subscription)")

    def _forward(self, path: str, point: Any) -> None:
        """Send one value as a frame, or count and log why it is not sent."""
        made = self._frames.to_frame(path, stamp_s(point), value_of(point), time.time())
        if isinstance(made, VssFrame):
            self.counts["values sent" if self._wire.send(made) else "while the bus was away"] += 1
            return
        self.counts[f"that {made}"] += 1
        what = "a value" if made is NotSent.LATE else f"a value of {path}"
        if made not in ORDINARY and (what, made) not in self._logged:
            self._logged.add((what, made))
            self._log.warning("%s %s: not sent (said once)", what, made)

    def _warn_once(self, text: str) -> None:
        if text != self._said:
            self._log.warning("%s; trying again", text)
        self._said = text


def stamp_s(point: Any) -> float:
    """Return the Unix time (s) at which the databroker got a data point, by its clock; 0 where it states
    none."""
    return float(point.timestamp.seconds + point.timestamp.nanos * 1e-9)


def value_of(point: Any) -> object:
    """Return the value of a data point, whatever its type; None where it has none."""
    kind = point.value.WhichOneof("typed_value")
    return None if kind is None else getattr(point.value, kind)


@contextlib.contextmanager
def cancelled_by_silence(call: Any, patience_s: float) -> Iterator[Callable[[], None]]:
    """Cancel a call that is silent for one to two times `patience_s`; yield the function to be called at each
    response."""
    received, over = threading.Event(), threading.Event()

    def watch() -> None:
        while not over.wait(patience_s):
            if not received.is_set():
                call.cancel()
            received.clear()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield received.set
    finally:
        over.set()
        call.cancel()
        thread.join()
