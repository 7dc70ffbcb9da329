"""Gathers the readings of a receiver that sits on the bus into fixes.

In: readings of the roles `gnss_*` in SI units, as the decoder gives them. Out: `GnssFix`es and
`SourceFault`s, by the rules that hold for sentences.

Position, motion and time come in one message or in several, more often than the receiver has news, or less.
A burst is gathered until all roles are there, until one comes again, or until nothing came for 0.3 of the
interval. What is the same as before is no new fix.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from tpmsd.onboard.sources.events import Event, GnssFix, InertialSample
from tpmsd.onboard.sources.gnss.nmea_checks import Episodes, EpochInterval, PositionChecks
from tpmsd.onboard.sources.gnss.nmea_clock import DAY_S, ReceiverClock
from tpmsd.onboard.sources.gnss.nmea_epoch import COURSE_MIN_SPEED_MPS
from tpmsd.onboard.sources.gnss.nmea_sentence import MAX_SPEED_MPS
from tpmsd.onboard.sources.gnss.noise import position_std

NAN = math.nan
PREFIX = "gnss_"
ALIVE_S = 1.0
"""Period at which unchanged values are reported again, s: a receiver at rest has not failed."""
_UNIX_FROM_S = 1e8
"""A time above is Unix time, one below is a time of the day."""
_EARTH_M = 6_371_000.0
_COMES_SEVERALLY = ("gnss_latitude", "gnss_longitude")


@dataclass(slots=True)
class _CanEpoch:
    arrival_s: float
    last_s: float
    values: dict[str, float] = field(default_factory=dict)


class CanFixAssembler:
    """Readings in, fixes out; one receiver.

    `counts`: `fixes`, `unchanged` and every kind of fault, as `NmeaAssembler` has them.
    """

    def __init__(self, roles: Collection[str], steps: Mapping[str, float] | None = None) -> None:
        """`roles` that are on the bus; `steps`: role -> resolution of its signal in SI units."""
        self.counts: dict[str, int] = dict.fromkeys(
            ("fixes", "unchanged", "checksum", "garbage", *Episodes.KINDS), 0
        )
        self._roles = frozenset(role for role in roles if role.startswith(PREFIX))
        steps = steps or {}
        self._speed_step_mps = steps.get("gnss_speed", 0.0)
        self._position_step_m = _EARTH_M * max(
            (steps.get(role, 0.0) for role in _COMES_SEVERALLY), default=0.0
        )
        self._burst: _CanEpoch | None = None
        self._interval = EpochInterval()
        self._episodes = Episodes(self.counts)
        self._clock = ReceiverClock()
        self._position_checks = PositionChecks(self._episodes)
        self._said: dict[str, float] = {}
        self._said_s = -math.inf

    @property
    def deadline_s(self) -> float:
        """The time after which `advance` ends the burst that is being gathered; infinite if there is none."""
        return math.inf if self._burst is None else self._burst.last_s + self._interval.gap_s

    def take(self, sample: InertialSample) -> list[Event]:
        """Add a reading to the burst; return the events of a burst that it ends."""
        time_s, role, value = sample
        events: list[Event] = []
        burst = self._burst
        if burst is not None and (
            role in burst.values or time_s > self.deadline_s or time_s < burst.last_s - self._interval.gap_s
        ):
            events += self._end_burst()
            burst = None
        if burst is None:
            burst = self._burst = _CanEpoch(time_s, time_s)
        burst.last_s = time_s
        burst.values[role] = value
        if role == "gnss_latitude":
            self._interval.learn(time_s % DAY_S)
        if len(burst.values) == len(self._roles):
            events += self._end_burst()
        return events

    def advance(self, time_s: float) -> list[Event]:
        """End the open burst if no reading came for long enough until `time_s`; return its events."""
        return self._end_burst() if time_s > self.deadline_s else []

    def flush(self) -> list[Event]:
        """End the open burst, because the input has ended; return its events."""
        return self._end_burst() if self._burst is not None else []

    def _end_burst(self) -> list[Event]:
        """Return the fix of the burst with the faults found in it; nothing for a repeated or incomplete
        one."""
        burst, self._burst = self._burst, None
        assert burst is not None
        at, values = burst.arrival_s, burst.values
        if not all(role in values for role in _COMES_SEVERALLY):
            return []  # a speed alone, from a message that comes more often
        if values == self._said and 0.0 <= at - self._said_s < ALIVE_S:
            self.counts["unchanged"] += 1
            return []
        utc_s = self._utc_s(values, at)
        self._said, self._said_s = values, at
        fix = GnssFix(at, utc_s, quality=1)
        events: list[Event] = []
        latitude, longitude = math.degrees(values["gnss_latitude"]), math.degrees(values["gnss_longitude"])
        speed = values.get("gnss_speed", NAN)
        none = values.get("gnss_fix") == 0 or (latitude == 0.0 and longitude == 0.0)
        wrong = ""
        if not none and not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            wrong = f"position {latitude:.5f}, {longitude:.5f}"
        elif abs(speed) > MAX_SPEED_MPS:
            wrong = f"speed {speed:.1f} m/s"
        events += self._episodes.note(at, "range", bool(wrong), wrong)
        events += self._episodes.note(at, "no_fix", none, "the receiver is alive but has no position")
        if none:
            fix = replace(fix, quality=0)
        elif not wrong:
            fix = self._with_position(self._with_motion(fix, values), latitude, longitude, values)
            fix, faults = self._position_checks.judge(fix)
            events += faults
        self.counts["fixes"] += 1
        return [*events, fix]

    def _with_motion(self, fix: GnssFix, values: Mapping[str, float]) -> GnssFix:
        """Return the fix with the burst's speed and course; NaN for what it has not."""
        speed = abs(values.get("gnss_speed", NAN))
        course = values.get("gnss_course", NAN) % (2.0 * math.pi)
        return replace(
            fix,
            speed_mps=speed,
            # Rounding is an error of a twelfth of its step squared; what Doppler adds the estimator knows.
            speed_std_mps=self._speed_step_mps / math.sqrt(12.0) if self._speed_step_mps else NAN,
            course_rad=NAN if speed < COURSE_MIN_SPEED_MPS else course,
        )

    def _with_position(
        self, fix: GnssFix, latitude: float, longitude: float, values: Mapping[str, float]
    ) -> GnssFix:
        """Return the fix with a position, its altitude and its standard deviation."""
        rounding_m = self._position_step_m / math.sqrt(12.0)
        return replace(
            fix,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_m=values.get("gnss_altitude", NAN),
            position_std_m=math.hypot(position_std(fix.quality, NAN), rounding_m),
        )

    def _utc_s(self, values: Mapping[str, float], arrival_s: float) -> float:
        """Return the Unix time of the burst, s; NaN if it has none or the same as the last one."""
        utc_s = values.get("gnss_utc", NAN)
        if not math.isfinite(utc_s) or utc_s < 0.0 or utc_s == self._said.get("gnss_utc", NAN):
            # A clock in whole seconds beside fixes that come more often says nothing of those in between.
            return NAN
        if utc_s < _UNIX_FROM_S:
            return self._clock.resolve(utc_s % DAY_S, None, arrival_s)
        return utc_s
