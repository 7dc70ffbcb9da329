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
    """Return the alignment of the receiver's UTC with the host clock by the speeds of rear left wheel and
    receiver."""
    wheel: list[tuple[float, float]] = []
    gnss: list[tuple[float, float]] = []
    assembler = NmeaAssembler()
    last_sample: RotationSample | None = None
    last_fix: GnssFix | None = None
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
                if last_sample is None or event.segment != last_sample.segment:
                    last_sample = event
                elif event.time_s - last_sample.time_s >= MIN_STEP_S:
                    step_s = event.time_s - last_sample.time_s
                    speed = (event.angle_rad - last_sample.angle_rad) * radius_m / step_s
                    wheel.append(((event.time_s + last_sample.time_s) / 2, speed))
                    last_sample = event
            elif isinstance(event, GnssFix):
                speed = event.speed_mps if math.isfinite(event.speed_mps) else _by_position(event, last_fix)
                if math.isfinite(speed) and math.isfinite(event.utc_s):
                    gnss.append((event.arrival_s, speed))
                last_fix = event
    if not wheel or not gnss:
        return None
    first, second = (np.array(sorted(series)).T for series in (wheel, gnss))
    return align(first[0], first[1], second[0], second[1])


def _by_position(fix: GnssFix, before: GnssFix | None) -> float:
    """Return the speed from two positions, good enough to compare its course over time."""
    if before is None or not fix.utc_s > before.utc_s:
        return math.nan
    north = (fix.latitude_deg - before.latitude_deg) * EARTH_M_PER_DEG
    east = (fix.longitude_deg - before.longitude_deg) * EARTH_M_PER_DEG
    return math.hypot(north, east * math.cos(math.radians(fix.latitude_deg))) / (fix.utc_s - before.utc_s)
