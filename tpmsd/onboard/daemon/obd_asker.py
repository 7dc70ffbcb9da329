"""Requests for the car's own speed over OBD-II: when they are sent, and when they stop.

In: monotonic time, whether the car moves, frames of the bus. Out: the frame that asks. Asking keeps a car's
gateway awake, which would drain the battery of one that is parked: so it is asked only while it moves, for a
minute after, and for a minute after the bus woke up. It is never asked again once another node (a tester)
asks under the same identifier.
"""

from __future__ import annotations

import math
from typing import Any

from tpmsd.car.config.model import ObdConfig
from tpmsd.onboard.sinks.can_frames import OutFrame
from tpmsd.onboard.sources.obd_speed import SPEED_REQUEST, speed_answer_kmh

LISTEN_S = 3.0
"""Nothing is sent before the bus was listened to for so long."""
AWAKE_S = 60.0
"""Time for which requests are sent after the last sign of motion or after the bus woke up, s."""
ASLEEP_S = 60.0
"""A bus that was silent for so long has slept."""
UNANSWERED, RARELY_S = 10, 60.0
"""A car that leaves so many requests in a row unanswered is asked at this period."""


class ObdAsker:
    """Asks one car; `received` and `frames` do nothing where the configuration does not ask."""

    def __init__(self, config: ObdConfig) -> None:
        self._config = config
        self._began_s = self._asked_s = self._spoke_s = -math.inf
        self._until_s = -math.inf
        self._in_vain = 0
        self._asked = self._answered = 0
        self._speed_kmh: int | None = None
        self.stopped = ""
        """Reason for which no more requests are sent."""

    def __bool__(self) -> bool:
        return self._config.speed

    def filters(self) -> list[dict[str, Any]]:
        """Return the CAN filters that let answers, and other nodes' requests, through."""
        if not self:
            return []
        extended = self._config.extended_ids
        first = self._config.answer_ids.start
        return [
            {
                "can_id": self._config.request_id,
                "can_mask": 0x1FFFFFFF if extended else 0x7FF,
                "extended": extended,
            },
            {"can_id": first, "can_mask": 0x1FFFFF00 if extended else 0x7F8, "extended": extended},
        ]

    def received(self, identifier: int, extended: bool, data: bytes, now_s: float) -> str:
        """Process a frame of the bus that is asked; return a line for the log if that ends the requests, else
        nothing."""
        if now_s - self._spoke_s > ASLEEP_S:
            self._began_s, self._until_s = now_s, now_s + AWAKE_S
        self._spoke_s = now_s
        if extended != self._config.extended_ids:
            return ""
        if identifier == self._config.request_id and not self.stopped:
            self.stopped = f"another node sends 0x{identifier:X}"
            return f"[obd] the car is asked no more: {self.stopped}"
        if identifier in self._config.answer_ids and (kmh := speed_answer_kmh(data)) is not None:
            self._answered, self._in_vain, self._speed_kmh = self._answered + 1, 0, kmh
            if kmh > 0:
                self._until_s = now_s + AWAKE_S
        return ""

    def frames(self, now_s: float, moving: bool) -> list[OutFrame]:
        """Return the request if one is due, else nothing; `moving`: wheels or receiver report motion. Call
        once per round."""
        if moving:
            self._until_s = now_s + AWAKE_S
        period_s = RARELY_S if self._in_vain >= UNANSWERED else self._config.period_s
        early = now_s - self._began_s < LISTEN_S or now_s - self._asked_s < period_s
        if not self or self.stopped or early or now_s > min(self._until_s, self._spoke_s + ASLEEP_S):
            return []
        self._asked_s = now_s
        self._asked, self._in_vain = self._asked + 1, self._in_vain + 1
        if self._in_vain >= UNANSWERED:
            self._speed_kmh = None
        return [OutFrame(self._config.request_id, self._config.extended_ids, SPEED_REQUEST)]

    def status(self) -> dict[str, Any]:
        """Return the values for the status document; `speed_kmh` is null where the car does not answer."""
        return {
            "asked": self._asked,
            "answered": self._answered,
            "speed_kmh": self._speed_kmh,
            "stopped": self.stopped,
        }
