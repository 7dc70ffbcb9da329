"""MQTT messages that follow from documents; the network is not here.

In: summaries, one after the other, and what the broker retains of an earlier run. Out: messages. State and
the alarms that stand are retained and always true; an event is sent once for each alarm raised or cleared,
and bears a key by which a receiver can tell a repetition.

While the broker is away, states are not kept (the next one is the truth), events are, up to `MAX_EVENTS`.
"""

from __future__ import annotations

import json
import math
import re
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from tpmsd.foundation.plain import number
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.bridges.summary import Alarm, DaemonSummary, WheelSummary

MAX_EVENTS = 500
"""Events kept while the broker is away: an hour with one every seven seconds."""
MAX_PAYLOAD_BYTES = 65536
KIND = re.compile(r"[a-z][a-z_]{0,49}")
"""Kinds of alarms, of this version or of another: whoever may write to the broker must not put other text
into our messages."""
LONGEST_S = 1e12
"""Latest time at which an alarm can have been raised, Unix seconds."""


class Message(NamedTuple):
    """One message to be published."""

    topic: str
    payload: str
    retain: bool
    qos: int = 1


@dataclass(frozen=True, slots=True)
class Topics:
    """Names below the base topic."""

    base: str

    @property
    def state(self) -> str:
        """Return the topic of the whole state as JSON, retained."""
        return f"{self.base}/state"

    @property
    def alarms(self) -> str:
        """Return the topic of the active alarms, retained."""
        return f"{self.base}/alarms"

    @property
    def event(self) -> str:
        """Return the topic of one message per alarm raised or cleared, not retained."""
        return f"{self.base}/event"

    @property
    def availability(self) -> str:
        """Return the topic of `online` or `offline`, retained; also the last will."""
        return f"{self.base}/availability"


class Announcer:
    """Retained state and single events as MQTT messages, from one summary after the other."""

    def __init__(self, topics: Topics, period_s: float) -> None:
        """`period_s`: period at which numbers are sent while nothing else changes."""
        self._topics = topics
        self._period_s = period_s
        self._known: dict[str, Alarm] | None = None
        """Alarms that were announced, by key; None until it is known what an earlier run announced."""
        self._waiting: deque[DaemonSummary] = deque(maxlen=MAX_EVENTS)
        """Changes seen before that was known."""
        self._sent_s = -math.inf
        self._sent: object = None
        self.events: deque[Message] = deque(maxlen=MAX_EVENTS)
        self.dropped = 0

    @property
    def is_ready(self) -> bool:
        """Return whether it is known which alarms were announced before."""
        return self._known is not None

    def recall(self, payload: bytes | None) -> None:
        """Process the retained message of the topic `alarms`, then the summaries queued until now; None: it
        has none."""
        self._known = {} if payload is None else {alarm.key: alarm for alarm in alarms_of_payload(payload)}
        while self._waiting:
            self.update(self._waiting.popleft())

    def update(self, summary: DaemonSummary) -> None:
        """Queue an event for each alarm raised or cleared since the last summary."""
        if not summary.ready:
            return
        if self._known is None:
            if not self._waiting or self._waiting[-1].alarms != summary.alarms:
                self._waiting.append(summary)
            return
        active = {alarm.key: alarm for alarm in summary.alarms}
        for key, alarm in self._known.items():
            if key not in active:
                self._queue_event("cleared", alarm)
        for key, alarm in active.items():
            if key not in self._known:
                self._queue_event("raised", alarm)
        self._known = active

    def state(self, summary: DaemonSummary, now_s: float, again: bool = False) -> list[Message]:
        """Return the messages of state and alarms, if due; `again`: the broker may have forgotten them."""
        discrete = (
            [(wheel.name, wheel.state, wheel.problem) for wheel in summary.wheels],
            [alarm.key for alarm in summary.alarms],
            summary.health,
        )
        if not again and discrete == self._sent and 0.0 <= now_s - self._sent_s < self._period_s:
            return []
        changed = again or self._sent is None or discrete != self._sent
        self._sent, self._sent_s = discrete, now_s
        messages = [Message(self._topics.state, _json(state_document(summary)), True)]
        if changed:
            alarms = [_alarm_document(alarm) for alarm in summary.alarms]
            messages.append(Message(self._topics.alarms, _json(alarms), True))
        return messages

    def _queue_event(self, state: str, alarm: Alarm) -> None:
        if len(self.events) == MAX_EVENTS:
            self.dropped += 1  # the oldest goes: the newest say how it is
        document = _alarm_document(alarm) | {"state": state}
        self.events.append(Message(self._topics.event, _json(document), False))


def state_document(summary: DaemonSummary) -> dict[str, Any]:
    """Return the state as the document that is published."""
    return {
        "schema": "tpmsd.mqtt/1",
        "health": summary.health,
        "malfunction": summary.malfunction,
        "can": summary.can,
        "gnss": summary.gnss,
        "wheels": {wheel.name: _wheel_document(wheel) for wheel in summary.wheels},
        "alarms": [_alarm_document(alarm) for alarm in summary.alarms],
    }


def _wheel_document(wheel: WheelSummary) -> dict[str, Any]:
    """Return the values of a wheel for MQTT; a gain of pressure is sent as a loss of 0."""
    document = {key: value for key, value in asdict(wheel).items() if key != "name"}
    if wheel.pressure_loss_percent is not None:
        document["pressure_loss_percent"] = max(wheel.pressure_loss_percent, 0.0)  # a gain is no loss
    return document


def alarms_of_payload(payload: bytes) -> Iterable[Alarm]:
    """Return the alarms in a retained message; empty for a payload that is not a list of alarms."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        return []
    try:
        raw = json.loads(payload)
    except (ValueError, RecursionError):
        return []
    out = []
    for one in raw if isinstance(raw, list) else []:
        if not isinstance(one, dict):
            continue
        kind, wheel, raised = one.get("kind"), one.get("wheel"), one.get("time")
        time_s = number(raised)
        if not isinstance(kind, str) or KIND.fullmatch(kind) is None or wheel not in (None, *WHEELS):
            continue
        if raised is not None and (time_s is None or abs(time_s) > LONGEST_S):
            continue
        out.append(Alarm(kind, wheel, time_s))
    return out


def _alarm_document(alarm: Alarm) -> dict[str, Any]:
    return {
        "key": alarm.key,
        "kind": alarm.kind,
        "wheel": alarm.wheel,
        "time": alarm.time_s,
        "deviation_mm": alarm.deviation_mm,
        "reason": alarm.reason,
    }


def _json(document: object) -> str:
    return json.dumps(document, allow_nan=False, separators=(",", ":"))
