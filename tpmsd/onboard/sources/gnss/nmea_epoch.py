"""Gathers the sentences of one epoch into one fix.

In: lines with their time of arrival (from the serial line or a log). Out: `GnssFix`es and `SourceFault`s.

A burst is the run of sentences of one epoch. It ends when a sentence with another UTC comes, when a type of
sentence comes again, or when nothing came for 0.3 of the epoch interval. The last rule is judged by the time
stamps alone, whether the next line brings it to light or `advance` does; so a live run and the replay of its
log give the same fixes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from tpmsd.onboard.sources.events import Event, GnssFix, SourceFault
from tpmsd.onboard.sources.gnss.nmea_checks import Episodes, EpochInterval, PositionChecks, without_position
from tpmsd.onboard.sources.gnss.nmea_clock import ReceiverClock
from tpmsd.onboard.sources.gnss.nmea_sentence import (
    ACCURACY,
    HANDLED,
    OTHER,
    NmeaReading,
    SentenceError,
    decode_sentence,
)
from tpmsd.onboard.sources.gnss.noise import GST_MAX_AGE_S, position_std

NAN = math.nan
COURSE_MIN_SPEED_MPS = 0.5
"""Below this the course of a receiver is noise."""
CHECKSUMS_EXPECTED = 10
"""Sentences with a checksum after which one without is rejected."""
_SAME_TIME_S = 5e-4
_POSITION_ORDER = ("GGA", "GNS", "RMC", "GLL", "VTG")
_SILENT = NmeaReading("other")
"""A sentence without a value, in place of one that did not come."""
_SPEAKS_OF_EPOCH = frozenset({"RMC", "GGA", "VTG", "GNS", "GLL"})


@dataclass(slots=True)
class _Burst:
    """The sentences of one epoch so far."""

    arrival_s: float
    last_s: float
    time_of_day_s: float = NAN
    readings: dict[str, NmeaReading] = field(default_factory=dict)
    lines: dict[str, bytes] = field(default_factory=dict)


class NmeaAssembler:
    """Lines in, fixes out; one receiver, state for one epoch.

    Every epoch in which the receiver spoke of its motion yields a `GnssFix`, also one without a position: it
    shows that the receiver is alive and what time it has. `counts` has sentences by type, and `fixes`,
    `ignored`, `no_checksum`, and every kind of fault: `checksum`, `garbage`, `range`, `no_fix`, `frozen`,
    `leap`, `repeated`, `week_rollover`. Faults of the last six kinds are reported once per episode but
    counted every time.
    """

    def __init__(self) -> None:
        kinds = (*sorted(HANDLED), "fixes", "ignored", "no_checksum", "checksum", "garbage")
        self.counts: dict[str, int] = dict.fromkeys((*kinds, *Episodes.KINDS), 0)
        self._clock = ReceiverClock()
        self._burst: _Burst | None = None
        self._interval = EpochInterval()
        self._episodes = Episodes(self.counts)
        self._position_checks = PositionChecks(self._episodes)
        self._checksummed = 0
        self._gst = (-math.inf, NAN)
        self._last: tuple[float, float] = (NAN, NAN)
        self._said_position = self._said_motion = False

    @property
    def deadline_s(self) -> float:
        """The time after which `advance` ends the epoch that is being gathered; infinite if there is none."""
        return math.inf if self._burst is None else self._burst.last_s + self._interval.gap_s

    def feed(self, time_s: float, line: bytes) -> list[Event]:
        """Process one line that arrived at `time_s`; return the events that it causes, in order. Never
        raises."""
        events: list[Event] = []
        burst = self._burst
        # The same comparison as in `advance`, to the last bit. A host clock that stepped back ends the burst
        # too.
        if burst is not None and (time_s > self.deadline_s or time_s < burst.last_s - self._interval.gap_s):
            events += self._end_epoch()
        try:
            reading = decode_sentence(line)
        except SentenceError as error:
            self.counts[error.kind] += 1
            if error.kind == "checksum":
                self._keep_open(time_s)
            events.append(SourceFault(time_s, "gnss", error.kind, error.detail))
            return events
        if not reading.checksummed:
            self.counts["no_checksum"] += 1
            if self._checksummed >= CHECKSUMS_EXPECTED and reading.kind != OTHER:
                # From a receiver that sends checksums, a line without one was damaged where it stood.
                self.counts["garbage"] += 1
                detail = f"{reading.kind} without a checksum, which this receiver sends"
                return [*events, SourceFault(time_s, "gnss", "garbage", detail)]
        elif self._checksummed < CHECKSUMS_EXPECTED:
            self._checksummed += 1
        if reading.kind == OTHER:
            self.counts["ignored"] += 1
            if not reading.proprietary:
                self._keep_open(time_s)
            return events
        self.counts[reading.kind] += 1
        if self._burst is not None and self._starts_epoch(self._burst, reading):
            if self._burst.lines.get(reading.kind) == line and not math.isnan(reading.time_of_day_s):
                # The very same sentence of the very same instant: a line written twice.
                self._keep_open(time_s)
                return events + self._episodes.note(time_s, "repeated", True, "a sentence came twice")
            events += self._end_epoch()
        self._add_reading(time_s, line, reading)
        return events

    def advance(self, time_s: float) -> list[Event]:
        """End the open epoch if no line came for long enough until `time_s`; return its events."""
        return self._end_epoch() if time_s > self.deadline_s else []

    def flush(self) -> list[Event]:
        """End the open epoch, because the input has ended; return its events."""
        return self._end_epoch() if self._burst is not None else []

    def _keep_open(self, time_s: float) -> None:
        """Extend the open epoch by a sentence of which nothing is used."""
        if self._burst is not None:
            self._burst.last_s = time_s

    @staticmethod
    def _starts_epoch(burst: _Burst, reading: NmeaReading) -> bool:
        """Return whether a reading is of another epoch: at another time, or of a kind that the burst has
        already."""
        other_time = abs(reading.time_of_day_s - burst.time_of_day_s) > _SAME_TIME_S
        return other_time or reading.kind in burst.readings

    def _add_reading(self, time_s: float, line: bytes, reading: NmeaReading) -> None:
        """Add a reading to the open epoch, or begin one with it."""
        if self._burst is None:
            self._burst = _Burst(time_s, time_s)
        self._burst.last_s = time_s
        self._burst.readings[reading.kind] = reading
        self._burst.lines[reading.kind] = line
        if not math.isnan(reading.time_of_day_s):
            self._burst.time_of_day_s = reading.time_of_day_s
            self._interval.learn(reading.time_of_day_s)

    def _end_epoch(self) -> list[Event]:
        """Return the fix of the open epoch with the faults found in it."""
        burst, self._burst = self._burst, None
        assert burst is not None
        readings, at = burst.readings, burst.arrival_s
        events: list[Event] = []
        utc_s = self._resolve_time(burst, events)
        if (gst := readings.get("GST")) is not None:
            self._gst = (at, gst.position_std_m)
        if _SPEAKS_OF_EPOCH.isdisjoint(readings):
            return events
        wrong = next((r.out_of_range for r in readings.values() if r.out_of_range), "")
        events += self._episodes.note(at, "range", bool(wrong), wrong)
        fix = merge_readings(readings, self._gst_std(at), at, utc_s)
        if fix.quality == 0 and any(reading.valid is False for reading in readings.values()):
            events += self._episodes.note(at, "no_fix", True, "the receiver is alive but has no position")
        elif math.isfinite(fix.latitude_deg):
            events += self._episodes.note(at, "no_fix", False)
        news = self._without_repeats(fix, burst.time_of_day_s)
        if news is not fix and not _has_content(news):
            return events + self._episodes.note(at, "repeated", True, "an epoch came twice")
        events += self._episodes.note(at, "repeated", False)
        fix = news
        if math.isfinite(fix.latitude_deg):
            fix, faults = self._position_checks.judge(fix)
            events += faults
        self.counts["fixes"] += 1
        events.append(fix)
        return events

    def _resolve_time(self, burst: _Burst, events: list[Event]) -> float:
        """Return the epoch's Unix time, s, NaN if unknown; appends the fault of a 1024-week rollover."""
        dated = (burst.readings.get(kind) for kind in ("ZDA", "RMC"))
        day = next((reading.unix_day for reading in dated if reading and reading.unix_day is not None), None)
        before = self._clock.rollovers
        utc_s = self._clock.resolve(burst.time_of_day_s, day, burst.arrival_s)
        if self._clock.rollovers != before:
            self.counts["week_rollover"] += 1
            detail = f"date {abs(self._clock.rollovers) * 1024} weeks off, corrected"
            events.append(SourceFault(burst.arrival_s, "gnss", "week_rollover", detail))
        return utc_s

    def _gst_std(self, arrival_s: float) -> float:
        """Return the position's standard deviation by the last GST, m; NaN if that is too old."""
        time_s, std_m = self._gst
        return std_m if abs(arrival_s - time_s) < GST_MAX_AGE_S else NAN

    def _without_repeats(self, fix: GnssFix, time_of_day_s: float) -> GnssFix:
        """Return the fix without position or motion that was already reported of the same instant, lest it
        count twice in an estimate.

        Two talkers, a slow line that splits an epoch, a log written twice and a stuck receiver clock do that.
        The time of day is compared along with UTC, because second 60 and the second after it have the same
        Unix time.
        """
        instant = (fix.utc_s, time_of_day_s)
        if math.isnan(fix.utc_s) or instant != self._last:
            self._last = instant
            self._said_position = self._said_motion = False
        has_position, has_motion = math.isfinite(fix.latitude_deg), math.isfinite(fix.speed_mps)
        if has_position and self._said_position:
            fix = without_position(fix)
        if has_motion and self._said_motion:
            fix = replace(fix, speed_mps=NAN, course_rad=NAN)
        self._said_position |= has_position
        self._said_motion |= has_motion
        return fix


def merge_readings(
    readings: dict[str, NmeaReading],
    gst_std_m: float = NAN,
    arrival_s: float = NAN,
    utc_s: float = NAN,
) -> GnssFix:
    """Return the fix of one epoch: each quantity from the sentence that states it most accurately.

    Position from GGA, GNS, RMC, GLL in that order (only the first two know height and HDOP); speed from RMC,
    which has its own UTC, before VTG. If any sentence says that there is no solution, there is none.
    """
    gga, gns, rmc, vtg = [readings.get(kind, _SILENT) for kind in ("GGA", "GNS", "RMC", "VTG")]
    hdop = _first_finite(gga.hdop, gns.hdop)
    if False in [reading.valid for reading in readings.values()]:
        return GnssFix(arrival_s, utc_s, quality=0, hdop=hdop)
    quality, located = None, None
    for kind in _POSITION_ORDER:
        if kind in readings:
            reading = readings[kind]
            quality = reading.quality if quality is None else quality
            if located is None and math.isfinite(reading.latitude_deg):
                located = reading
    quality = 1 if quality is None else quality
    speed_mps, course_rad = (
        _first_finite(rmc.speed_mps, vtg.speed_mps),
        _first_finite(rmc.course_rad, vtg.course_rad),
    )
    latitude_deg = longitude_deg = altitude_m = std_m = NAN
    if located is not None and located.latitude_deg == 0.0 and located.longitude_deg == 0.0:
        # Exactly 0/0 is sea, and the mark of a receiver that says "valid" too early.
        quality = 0
    elif located is not None:
        latitude_deg, longitude_deg = located.latitude_deg, located.longitude_deg
        altitude_m = _first_finite(gga.altitude_m, gns.altitude_m)
        std_m = position_std(quality, hdop, gst_std_m)
    return GnssFix(
        arrival_s,
        utc_s,
        latitude_deg,
        longitude_deg,
        altitude_m,
        quality=quality,
        hdop=hdop,
        position_std_m=std_m,
        speed_mps=speed_mps,
        speed_std_mps=_first_finite(readings.get(ACCURACY, _SILENT).speed_std_mps),
        course_rad=NAN if speed_mps < COURSE_MIN_SPEED_MPS else course_rad,
    )


def _first_finite(*values: float) -> float:
    """Return the first finite value; NaN if there is none."""
    for value in values:
        if math.isfinite(value):
            return value
    return NAN


def _has_content(fix: GnssFix) -> bool:
    """Return whether a fix has a position or a speed."""
    return math.isfinite(fix.latitude_deg) or math.isfinite(fix.speed_mps)
