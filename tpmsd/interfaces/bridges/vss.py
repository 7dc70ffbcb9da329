"""`tpmsd bridge vss`: low pressure of each tyre, to a KUKSA databroker as signals of the VSS.

In: the status socket, a databroker (gRPC, kuksa.val.v2). Out: `Tire.IsPressureLow` of each wheel
(`vss_names.py`): true or false while the wheel is monitored, no value while nobody knows. A value counts as
sent once the databroker has taken it; after a failure all of them are sent again, and every `period_s` in any
case, for a databroker that was restarted has forgotten them.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable
from typing import Any

from tpmsd.interfaces.bridges.summary import MALFUNCTION, DaemonSummary, summarise
from tpmsd.interfaces.bridges.vss_connection import RETRY_S, DatabrokerConnection, DatabrokerSettings
from tpmsd.interfaces.bridges.vss_names import IS_PRESSURE_LOW, MEANS_LOW

WATCHED = frozenset({"monitoring", "alarm"})
"""States of a wheel in which it is known whether it is soft."""


def pressure_low(summary: DaemonSummary) -> dict[str, bool | None]:
    """Return whether the pressure of each wheel is low; None where that is not known."""
    low = {alarm.wheel for alarm in summary.alarms if alarm.kind in MEANS_LOW}
    failed = {alarm.wheel for alarm in summary.alarms if alarm.kind == MALFUNCTION}
    states = {wheel.name: wheel.state for wheel in summary.wheels}
    return {
        wheel: True
        if wheel in low
        else False
        if states.get(wheel) in WATCHED and wheel not in failed
        else None
        for wheel in IS_PRESSURE_LOW
    }


class VssBridge:
    """Bridge from the status of one daemon to the VSS signals of one databroker."""

    def __init__(self, settings: DatabrokerSettings, log: logging.Logger, period_s: float = 10.0) -> None:
        """Send all values again every `period_s`. ConfigError as `DatabrokerConnection` has it."""
        self._databroker, self._log, self._period_s = DatabrokerConnection(settings), log, period_s
        self._sent: dict[str, bool | None] = {}
        self._absent: set[str] = set()
        """Wheels for which the databroker's specification has no signal."""
        self._due_s = self._again_s = -math.inf
        self._said = ""

    def run(self, documents: Iterable[dict[str, Any] | None]) -> None:
        """Send the documents until they end; then send that nothing is known any more."""
        try:
            for document in documents:
                self.step(document, time.monotonic())
        finally:
            self.step(None, math.inf)
            self._databroker.close()

    def step(self, document: dict[str, Any] | None, now_s: float) -> None:
        """Send the low-pressure values of one document that are new or due again."""
        values: dict[str, bool | None] = dict.fromkeys(IS_PRESSURE_LOW)
        if document is not None:
            summary = summarise(document)
            if not summary.ready:
                return
            values = pressure_low(summary)
        if now_s >= self._due_s:
            self._sent, self._due_s = {}, now_s + self._period_s
        if now_s < self._again_s:
            return
        for wheel, low in values.items():
            if wheel in self._absent or (wheel in self._sent and self._sent[wheel] == low):
                continue
            if not self._publish(wheel, low):
                self._sent, self._again_s = {}, now_s + RETRY_S
                return
            self._sent[wheel] = low

    def _publish(self, wheel: str, low: bool | None) -> bool:
        """Send one value; return False if it is to be sent again."""
        databroker = self._databroker
        point = databroker.types.Datapoint()
        point.timestamp.GetCurrentTime()
        if low is not None:
            point.value.bool = low
        request = databroker.requests.PublishValueRequest(
            signal_id=databroker.types.SignalID(path=IS_PRESSURE_LOW[wheel]), data_point=point
        )
        try:
            databroker.call("PublishValue", request)
        except databroker.error as error:
            if (reason := databroker.failure(error)) != "not_found":
                self._warn_once(f"the databroker does not take values ({reason})")
                return False
            self._absent.add(wheel)
            self._log.warning("the databroker does not know %s: left out", IS_PRESSURE_LOW[wheel])
            return True
        if self._said:
            self._log.info("the databroker takes values again")
            self._said = ""
        return True

    def _warn_once(self, text: str) -> None:
        if text != self._said:
            self._log.warning("%s; trying again", text)
        self._said = text
