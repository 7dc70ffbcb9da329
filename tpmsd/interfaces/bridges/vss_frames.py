"""Values of a databroker as CAN frames: those that are new, young and plausible, and no others.

In: path, stamp and value of each data point, and the host's time at which it came. Out: a `VssFrame` of
`vss.dbc`, which names the path of each signal, or why there is none.

A frame is stamped by whoever receives it, so it must leave when its value comes. A value whose stamp is the
one of before is not renewed; a value that was held up on its way says nothing of now. The clocks of
databroker and host need not agree: a delay counts from the least one of the last minute.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from enum import StrEnum
from importlib import resources
from typing import Any, NamedTuple

import cantools

from tpmsd.interfaces.bridges.vss_names import FIX_TYPE, GNSS_TIME

LATE_S = 0.1
"""Excess of a wheel speed's age over the usual one, at most, s: at 3 m/s2 one reading of many is wrong by 0.3
m/s."""
WINDOW_S = 30.0
"""Window of the least delay, s: that of the last one to two windows; a clock that was set right counts after
that."""


class NotSent(StrEnum):
    """Reason for which a value is not sent."""

    NO_VALUE = "has no value"
    NOT_RENEWED = "is not renewed"
    LATE = "was held up"
    MALFORMED = "is of another type or form"
    OUT_OF_RANGE = "is out of range"


class VssFrame(NamedTuple):
    """Frame that is sent: an identifier of 11 bits and up to 8 bytes."""

    identifier: int
    data: bytes


def vss_dbc() -> str:
    """Return the text of `vss.dbc`."""
    return (resources.files("tpmsd.interfaces.bridges") / "vss.dbc").read_text("utf-8")


class Delays:
    """The least of the delays of some time, and which ones are late against it."""

    def __init__(self) -> None:
        self._began_s = -math.inf
        self._min_s = self._before_s = math.inf

    def late(self, stamp_s: float, now_s: float) -> bool:
        """Note one delay and return whether it exceeds the least recent one by `LATE_S`; `stamp_s` by the
        databroker's clock, `now_s` by the host's."""
        if not 0.0 <= now_s - self._began_s <= WINDOW_S:
            self._before_s, self._min_s, self._began_s = self._min_s, math.inf, now_s
        delay_s = now_s - stamp_s
        self._min_s = min(self._min_s, delay_s)
        return delay_s - min(self._min_s, self._before_s) > LATE_S


class VssFrames:
    """One databroker's values as frames."""

    def __init__(self) -> None:
        database: Any = cantools.database.load_string(vss_dbc(), "dbc")
        self._messages: dict[str, Any] = {one.signals[0].comment: one for one in database.messages}
        self._stamps_s: dict[str, float] = {}
        self._delays = Delays()

    @property
    def paths(self) -> tuple[str, ...]:
        """Return all signals that may be sent, the wheels first."""
        return tuple(self._messages)

    def note(self, path: str, stamp_s: float) -> None:
        """Note a value that was there before: known, and not sent."""
        if path in self._messages:
            self._stamps_s[path] = stamp_s

    def to_frame(self, path: str, stamp_s: float, value: object, now_s: float) -> VssFrame | NotSent:
        """Return the frame of a value, or the reason why it is not sent.

        `path` is one of `paths`; `value` is None where the databroker has none.
        """
        message = self._messages[path]
        if stamp_s == self._stamps_s.get(path):
            return NotSent.NOT_RENEWED
        self._stamps_s[path] = stamp_s
        if self._delays.late(stamp_s, now_s):
            return NotSent.LATE
        if value is None:
            return NotSent.NO_VALUE
        signal = message.signals[0]
        number = _value_number(path, value, flag=signal.maximum == 1)
        if number is None:
            return NotSent.MALFORMED
        if not signal.minimum <= number <= signal.maximum:
            return NotSent.OUT_OF_RANGE
        return VssFrame(message.frame_id, message.encode({signal.name: number}))


def _value_number(path: str, value: object, flag: bool) -> float | None:
    """Return a value in its signal's unit; None where its type or text is not that of the specification."""
    if path in _TEXTS:
        return _TEXTS[path](value) if isinstance(value, str) else None
    if isinstance(value, bool) is not flag or not isinstance(value, int | float):
        return None
    return float(value)


def _unix_ms(text: str) -> float | None:
    """Return an ISO 8601 instant as Unix milliseconds, UTC without a zone; None where it is none."""
    try:
        moment = datetime.fromisoformat(text)
        if "T" not in text:
            return None
        return round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * 1e3)
    except (ValueError, OverflowError):
        return None


def _fix_flag(text: str) -> float | None:
    """Return 0 for `NONE`, 1 for a fix in two or three dimensions however augmented; None for other text."""
    if text == "NONE":
        return 0.0
    return 1.0 if text.startswith(("TWO_D", "THREE_D")) else None


_TEXTS: dict[str, Callable[[str], float | None]] = {GNSS_TIME: _unix_ms, FIX_TYPE: _fix_flag}
