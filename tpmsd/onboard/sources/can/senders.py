"""Detection of a second sender of a message.

In: the stamp of each frame that is used, the values of its wheels, and whether they jumped. Out: why the
message, or one wheel of it, is not to be trusted. Pure: the only clock is the frames' own.

A node that sends frames under a foreign identifier can be detected by two things, and neither needs a key:

    rate          the true sender goes on, so there are more frames than it ever sent. Each frame takes a
                  token; tokens come at the known rate and a quarter more; without a token the message is
                  doubted. A sender that became faster itself is accepted after `ACCEPT_S` in which its values
                  ran on as evenly as before.
    plausibility  two values in turn: a counter that jumps in every few frames is doubted by itself, whatever
                  the rate, for nobody knows which of the two is the wheel's.

What it cannot tell: a node that silences the true sender and takes over its rate, or one that was there from
the first frame on with values that a wheel may well have.
"""

from __future__ import annotations

import copy
from itertools import islice

FASTER = 1.25
"""Frames beyond the known rate that are tolerated: clocks of adapters, and frames that were sent again."""
BURST_S, BURST_FRAMES = 1.0, 20.0
"""Frames that may come at once: those of a second, for adapters hand them over in bunches."""
LEARN_S = 10.0
"""The fastest rate of the first seconds is the known one: some senders start slowly."""
WINDOW_S, MIN_COUNT = 2.0, 5
GRACE_S = 1.0
GAP_S = 0.5
"""Silence after which a backlog may come at any rate, for a second, s."""
ACCEPT_S = 10.0
ROUGHER = 3.0
"""Second differences this much greater than before are of two senders' values in turn."""
_MEMORY, _TYPICAL_FACTOR = 1.0 / 32.0, 1.0 / 256.0
_REGULAR_SHARE = 0.7
"""Share of tokens below which the rate is irregular, so that the usual rate is not learned."""
IRREGULAR_LEAK = 0.15
"""Share of jumps among the readings of a wheel that is tolerated; two senders in turn make it a half."""
IRREGULAR_LIMIT = 8.0


class _Roughness:
    """Mean second difference of one signal: small for a smooth road or an even braking."""

    __slots__ = ("_first", "_second", "now", "resolution", "usual")

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.now = self.usual = 0.0
        self._first = self._second = float("nan")

    def update(self, value: float) -> None:
        """Update the mean absolute second difference by the next value."""
        bend = abs(value - 2.0 * self._second + self._first)
        self._first, self._second = self._second, value
        if bend == bend:
            self.now += _MEMORY * (bend - self.now)

    @property
    def excessive(self) -> bool:
        """True if the roughness exceeds `ROUGHER` times the usual one and two steps of the signal."""
        return self.now > ROUGHER * self.usual + 2.0 * self.resolution

    def learn_typical(self) -> None:
        """Move the usual value towards the present one."""
        self.usual += _TYPICAL_FACTOR * (self.now - self.usual)


class SenderWatch:
    """Watches one message (or one multiplexer branch of it)."""

    __slots__ = (
        "_burst",
        "_clean_since_s",
        "_count",
        "_fastest_s",
        "_grace_until_s",
        "_irregular",
        "_last_s",
        "_lately_s",
        "_period_s",
        "_rough",
        "_since_s",
        "_sound",
        "_tokens",
        "_window_s",
        "compares",
        "fast",
        "uneasy",
    )

    def __init__(self, resolutions: tuple[float | None, ...]) -> None:
        """`resolutions`: per signal of the message its step, or None where its values are not compared."""
        self.fast = False
        """True if more frames come than the sender ever sent."""
        self._period_s = 0.0
        """Period once it is known; 0 before that."""
        self._fastest_s = self._lately_s = float("inf")
        self._since_s = self._last_s = self._window_s = float("nan")
        self._count = 0
        self._grace_until_s = self._clean_since_s = -float("inf")
        self._burst = self._tokens = 0.0
        self._irregular = [0.0] * len(resolutions)
        self._sound = [True] * len(resolutions)
        self.uneasy = False
        """True if something was irregular lately: then every value is to be taken, else only irregular
        ones."""
        self._rough = tuple(None if step is None else _Roughness(step) for step in resolutions)
        self.compares = tuple(step is not None for step in resolutions)
        """Flags per signal: True if its values are compared from frame to frame."""

    @property
    def detail(self) -> str:
        """Text of a fault: the rate that is exceeded; empty if it is not."""
        return f"more than its {1.0 / self._period_s:.0f} frames a second" if self.fast else ""

    def copied(self) -> SenderWatch:
        """Return an independent copy."""
        other = copy.copy(self)
        other._irregular, other._sound = self._irregular.copy(), self._sound.copy()
        other._rough = tuple(copy.copy(rough) for rough in self._rough)
        return other

    def restart(self, time_s: float) -> None:
        """Begin the rate's measurement again behind a step of the clock or an absence of the message."""
        self._since_s += time_s - self._last_s
        self._last_s = self._window_s = time_s
        self._count = 0
        self._grace_until_s = time_s + GRACE_S
        self._tokens = self._burst

    def judge_frame(self, time_s: float) -> bool:
        """Update the rate by a frame's stamp (later than the one before); return whether the message is
        doubted because it comes too fast."""
        if self._since_s != self._since_s:
            self._since_s = self._window_s = self._last_s = time_s
        if time_s - self._last_s > GAP_S:
            self.restart(time_s)
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        self._measure_interval(time_s)
        if not self._period_s:
            self._fastest_s = min(self._fastest_s, self._lately_s)
            if time_s - self._since_s >= LEARN_S and self._fastest_s < float("inf"):
                self._set_period(self._fastest_s)
            return False
        if time_s < self._grace_until_s:
            return self.fast
        self._tokens = min(self._tokens + FASTER * elapsed_s / self._period_s, self._burst) - 1.0
        if self._tokens < 0.0:
            self._tokens = 0.0
            if not self.fast:
                self.fast, self._clean_since_s = True, time_s
        elif self.fast and self._tokens > 0.5 * self._burst:
            self.fast = False
        if self.fast:
            self._accept_faster_rate(time_s)
        elif self._tokens > _REGULAR_SHARE * self._burst:
            for rough in self._rough:
                if rough is not None:
                    rough.learn_typical()
        return self.fast

    def judge_value(self, index: int, value: float, jumped: bool, sound: bool) -> bool:
        """Judge one signal's value; return whether it is doubted because successive values contradict one
        another.

        `jumped`: a reading was found odd with it; `sound`: it made a sample. Odd values with no sound ones
        between them are of one sender, and are left out already.
        """
        rough = self._rough[index]
        if rough is not None:
            rough.update(value)
        self._sound[index] |= sound
        irregular = max(self._irregular[index] - IRREGULAR_LEAK, 0.0)
        if jumped and self._sound[index]:
            irregular = min(irregular + 1.0, 2.0 * IRREGULAR_LIMIT)
            self._sound[index] = sound
        self._irregular[index] = irregular
        if irregular == 0.0:
            self._sound[index] = True
        self.uneasy = self.fast or any(self._irregular)
        if self.fast and (jumped or (rough is not None and rough.excessive)):
            self._clean_since_s = self._last_s
        return irregular > IRREGULAR_LIMIT

    def judge_regular(self, times_s: list[float], compared: list[tuple[int, list[float]]]) -> int:
        """Apply `judge_frame` and `judge_value` to frames and their values in order, up to the first that is
        doubted; return its index. `compared`: index and values of each signal that is compared."""
        index = 0
        while index < len(times_s):
            if not compared and (passed := self._pass_regular(times_s, index)):
                index += passed
                continue
            if self.judge_frame(times_s[index]) or any(
                [self.judge_value(number, values[index], False, True) for number, values in compared]  # noqa: C419
            ):
                break
            index += 1
        return index

    def _pass_regular(self, times_s: list[float], start: int) -> int:
        """Apply `judge_frame` to the stamps from `start` on, as long as the known rate is kept; return their
        number."""
        period_s, burst, tokens, last_s = self._period_s, self._burst, self._tokens, self._last_s
        window_s, grace_until_s, passed = self._window_s, self._grace_until_s, 0
        if not period_s or self.fast:
            return 0
        for time_s in islice(times_s, start, None):
            elapsed_s = time_s - last_s
            left = tokens + FASTER * elapsed_s / period_s
            if left > burst:
                left = burst
            left -= 1.0
            if (
                left < 0.0
                or elapsed_s > GAP_S
                or time_s < grace_until_s
                or not 0.0 <= time_s - window_s < WINDOW_S
            ):
                break
            tokens, last_s, passed = left, time_s, passed + 1
        self._tokens, self._last_s = tokens, last_s
        self._count += passed
        return passed

    def _measure_interval(self, time_s: float) -> None:
        """Measure the mean interval of frames, over windows so long that bunches do not matter."""
        self._count += 1
        span_s = time_s - self._window_s
        if span_s >= WINDOW_S or span_s < 0.0:
            if span_s >= WINDOW_S and self._count >= MIN_COUNT:
                self._lately_s = span_s / self._count
            self._window_s, self._count = time_s, 0

    def _set_period(self, period_s: float) -> None:
        """Set the sender's period, and the number of frames that may come at once."""
        self._period_s = period_s
        self._burst = self._tokens = max(BURST_S / period_s, BURST_FRAMES)

    def _accept_faster_rate(self, time_s: float) -> None:
        """Accept a faster rate as the sender's own if the values are as smooth as before."""
        if time_s - self._clean_since_s >= ACCEPT_S:
            self.fast = False
            self._set_period(min(self._lately_s, self._period_s))
