"""Brings the clock of a plain NMEA log (no host times) onto the clock of the CAN log.

In: a drive's frames and sentences. Out: what must be added to the sentences' UTC, or None where the speeds of
bus and receiver do not tell. Runs once over the drive before a replay.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from tpmsd.foundation.wheels import RL
from tpmsd.onboard.sources.align import Alignment, align
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.events import Event, GnssFix, RotationSample
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

MIN_STEP_S = 0.05
EARTH_M_PER_DEG = 111_320.0


def clock_offset(items: Iterable[object], decoder: CanDecoder, radius_m: float) -> Alignment | None:
    """Return the alignment of the receiver's UTC with the host clock.

    By the speeds of the rear left wheel and the receiver.
    """
    series = _SpeedSeries(radius_m)
    assembler = NmeaAssembler()
    for item in items:
        events: list[Event]
        if isinstance(item, CanFrame):
            if item.is_error or item.is_remote:
                continue
            events = decoder.decode(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            time_s, line = item[0], item[1]  # type: ignore[index]
            events = assembler.feed(time_s, line)
        for event in events:
            if isinstance(event, RotationSample) and event.wheel == RL:
                series.add_sample(event)
            elif isinstance(event, GnssFix):
                series.add_fix(event)
    if not series.wheel or not series.gnss:
        return None
    first, second = (np.array(sorted(one)).T for one in (series.wheel, series.gnss))
    return align(first[0], first[1], second[0], second[1])


class _SpeedSeries:
    """Speeds of one wheel and of the receiver, each (time in s, speed in m/s)."""

    def __init__(self, radius_m: float) -> None:
        self.wheel: list[tuple[float, float]] = []
        self.gnss: list[tuple[float, float]] = []
        self._radius_m = radius_m
        self._sample: RotationSample | None = None
        self._fix: GnssFix | None = None

    def add_sample(self, sample: RotationSample) -> None:
        """Add the wheel's mean speed since the last sample used, once `MIN_STEP_S` have passed."""
        last = self._sample
        if last is None or sample.segment != last.segment:
            self._sample = sample
        elif (step_s := sample.time_s - last.time_s) >= MIN_STEP_S:
            speed = (sample.angle_rad - last.angle_rad) * self._radius_m / step_s
            self.wheel.append(((sample.time_s + last.time_s) / 2, speed))
            self._sample = sample

    def add_fix(self, fix: GnssFix) -> None:
        """Add the receiver's speed, or that between two positions where it reports none."""
        speed = fix.speed_mps if math.isfinite(fix.speed_mps) else _speed_between(fix, self._fix)
        if math.isfinite(speed) and math.isfinite(fix.utc_s):
            self.gnss.append((fix.arrival_s, speed))
        self._fix = fix


def _speed_between(fix: GnssFix, before: GnssFix | None) -> float:
    """Return the mean speed between two positions, m/s, good enough to compare its course over time; NaN
    without two."""
    if before is None or not fix.utc_s > before.utc_s:
        return math.nan
    north = (fix.latitude_deg - before.latitude_deg) * EARTH_M_PER_DEG
    east = (fix.longitude_deg - before.longitude_deg) * EARTH_M_PER_DEG
    return math.hypot(north, east * math.cos(math.radians(fix.latitude_deg))) / (fix.utc_s - before.utc_s)
