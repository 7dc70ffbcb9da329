"""Faults of the CAN input: counted exactly, reported without a flood.

In: what went wrong, when and where. Out: `counts` ('fl.lost' -> 12) and `SourceFault` events, the first of an
episode at once and then at most one a second per kind and place.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.sources.events import Event, SourceFault

REPORT_INTERVAL_S = 1.0
_JUMPS = frozenset({"jump", "reset"})


class FaultLog:
    """Counts every fault and decides which ones are reported as events."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.shared: Counter[str] = Counter()
        """Excess of the sum over wheels and roles over the number of faulty frames, by kind."""
        self.jumps = 0
        """Readings of all wheels that could not follow the ones before."""
        self._reported_s: dict[str, float] = {}

    def note_message(
        self,
        out: list[Event],
        time_s: float,
        kind: str,
        origins: Sequence[int | str],
        detail: str = "",
        number: int = 1,
    ) -> None:
        """Count `number` faults of one message at each of its wheels and roles."""
        for origin in origins:
            self.note(out, time_s, kind, origin, detail, number)
        if len(origins) > 1:
            self.shared[kind] += number * (len(origins) - 1)

    def note(
        self,
        out: list[Event],
        time_s: float,
        kind: str,
        origin: int | str,
        detail: str = "",
        number: int = 1,
    ) -> None:
        """Count `number` faults at a wheel (its index) or a role; append an event to `out` if due."""
        wheel = origin if isinstance(origin, int) else None
        key = f"{WHEELS[origin] if isinstance(origin, int) else origin}.{kind}"
        self.counts[key] += number
        if kind in _JUMPS:
            self.jumps += number
        reported = self._reported_s.get(key)
        # A clock that stepped back must not silence the reports for as long as it stepped.
        if reported is None or not reported <= time_s < reported + REPORT_INTERVAL_S:
            self._reported_s[key] = time_s
            out.append(SourceFault(time_s, "can", kind, detail, wheel))
