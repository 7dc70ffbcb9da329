"""Events of simple drives, in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterable

from tpmsd.onboard.sources.events import Event, GnssFix, RotationRun, RotationSample
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.timeline import Timeline

START_S = 1_700_000_000.0
QUANTUM = 2 * math.pi / 48
_SQUARE = 0.00669437999014 * math.sin(math.radians(50.0)) ** 2
EARTH_M_PER_DEG = math.radians(6335439.327 / (1.0 - _SQUARE) ** 1.5 + 100.0)
"""Of latitude, at 50 degrees and 100 m of height, by the WGS-84 meridian radius of curvature."""


class Samples:
    """An observer that keeps every rotation sample in a list, taken one by one."""

    def __init__(self, seen: list[RotationSample]) -> None:
        self._seen = seen

    def add(self, sample: RotationSample) -> None:
        self._seen.append(sample)

    def extend(self, run: RotationRun) -> bool:
        return False


def stamp_of(event: Event) -> float:
    return event.arrival_s if isinstance(event, GnssFix) else event.time_s


def rotations(
    rate_radps: float,
    duration_s: float,
    period_s: float = 0.02,
    wheels: Iterable[int] = range(4),
    start_s: float = START_S,
    begin_s: float = 0.0,
) -> list[Event]:
    """Exact angles of wheels that turn steadily."""
    out: list[Event] = []
    for k in range(int(duration_s / period_s)):
        t = begin_s + k * period_s
        out += [RotationSample(start_s + t, wheel, rate_radps * t, QUANTUM, 0) for wheel in wheels]
    return out


def fixes(
    speed_mps: float,
    duration_s: float,
    period_s: float = 1.0,
    lag_s: float = 0.1,
    start_s: float = START_S,
    clock_offset_s: float = 0.0,
) -> list[Event]:
    """Fixes of a car that drives north; their UTC is the true time, their arrival that of the host."""
    out: list[Event] = []
    for k in range(int(duration_s / period_s)):
        t = k * period_s
        out.append(
            GnssFix(
                arrival_s=start_s + t + lag_s + clock_offset_s,
                utc_s=start_s + t,
                latitude_deg=50.0 + speed_mps * t / EARTH_M_PER_DEG,
                longitude_deg=8.0,
                altitude_m=100.0,
                quality=1,
                hdop=0.8,
                position_std_m=1.5,
                speed_mps=speed_mps,
                course_rad=0.0,
            )
        )
    return out


def merged(*streams: list[Event]) -> list[Event]:
    return sorted((event for stream in streams for event in stream), key=stamp_of)


def play(timeline: Timeline, events: Iterable[Event], finish: bool = True) -> list[Tick]:
    ticks = [tick for event in events for tick in timeline.add(event)]
    return ticks + (timeline.finish() if finish else [])
