"""The daemon's clock, which may run faster than real time for tests and demonstrations.

In: the host's two clocks. Out: logical time. Its wall clock stamps inputs; its monotonic clock is for
deadlines alone and never enters an estimate.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from tpmsd.foundation.errors import ConfigError

MAX_SCALE = 1000.0
_SAME_INSTANT_S = 1e-3
_TRIES = 5
"""A process may be held up between two readings, but not five times in a row."""


class Clock:
    """Logical time that runs `scale` times faster than real time from the moment of creation.

    At scale 1 (and without `start_s`) it is the host's clock as it is, with all its steps. At any other
    scale it starts at the host's time, or at `start_s` (epoch seconds), and runs on by the monotonic clock.
    """

    def __init__(
        self,
        scale: float = 1.0,
        *,
        start_s: float | None = None,
        wall: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """ConfigError for a scale that is not within 0.1 to `MAX_SCALE`."""
        if not 0.1 <= scale <= MAX_SCALE:
            raise ConfigError(f"speed-up {scale:g} is outside 0.1 to {MAX_SCALE:g}")
        self.scale = scale
        self._wall = wall
        self._monotonic = monotonic
        self._follows_host = scale == 1.0 and start_s is None
        self._wall_origin_s = wall()
        self._monotonic_origin_s = monotonic()
        self._start_s = self._wall_origin_s if start_s is None else start_s

    def now(self) -> float:
        """Return the host epoch seconds, logical."""
        if self._follows_host:
            return self._wall()
        return self._start_s + self.monotonic()

    def monotonic(self) -> float:
        """Return the logical seconds since the clock was made; never steps."""
        return (self._monotonic() - self._monotonic_origin_s) * self.scale

    def read(self) -> tuple[float, float]:
        """Return `now()` and `monotonic()` of one instant: their difference tells steps of the host's
        clock."""
        if not self._follows_host:
            monotonic_s = self.monotonic()
            return self._start_s + monotonic_s, monotonic_s
        for _ in range(_TRIES):
            before_s = self.monotonic()
            now_s = self._wall()
            after_s = self.monotonic()
            if after_s - before_s < _SAME_INSTANT_S:
                break
        return now_s, after_s

    def from_host(self, stamp_s: float) -> float:
        """Return the logical time of a stamp of the host's real clock (a kernel time stamp)."""
        if self._follows_host:
            return stamp_s
        return self._start_s + (stamp_s - self._wall_origin_s) * self.scale

    def to_real(self, seconds: float) -> float:
        """Return the real duration of a logical interval, s: the time to sleep."""
        return seconds / self.scale
