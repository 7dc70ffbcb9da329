"""Slip of all wheels against the receiver's speed, where all are driven (a part of `slip_slope`).

In: ticks. Out: a `SlipSecond` of each second in which all wheels and the receiver's speed are known.

A receiver tells its speed at an instant. So the wheels' speed and acceleration are those about that instant,
from the way that they rolled in the seconds before and after.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.onboard.monitor.sampling.slip_sums import SlipSecond
from tpmsd.onboard.monitor.settings import SLIP_SLOPE
from tpmsd.onboard.timeline.tick import Fix, Tick


class ReceiverSlip:
    """Slip of all wheels of one car against the receiver's speed."""

    def __init__(self, vehicle: VehicleConfig) -> None:
        self._radius_m = [float(radius) for radius in vehicle.wheel_radius_m]
        self._wheelbase_m, self._track_m = vehicle.wheelbase_m, vehicle.track_rear_m
        self._distances: deque[tuple[float, float, float]] = deque()
        """Time, way of the mean of all wheels and of right minus left at the rear, since an interruption."""
        self._fixes: deque[tuple[float, Fix]] = deque()
        """Time and fix, of those whose way is not complete yet."""
        self._second: list[SlipSecond] = []
        self._second_from_s = -math.inf

    def update(self, tick: Tick) -> list[SlipSecond]:
        """Update by a tick; return the points of the seconds that are complete."""
        fl, fr, rl, rr = (
            turn * radius for turn, radius in zip(tick.rotation_rad.tolist(), self._radius_m, strict=True)
        )
        distance_m, apart_m = 0.25 * (fl + fr + rl + rr), rr - rl
        if tick.gap_s > 0.0 or not math.isfinite(distance_m):
            self._distances.clear()
            self._fixes.clear()
        if not math.isfinite(distance_m):
            return []
        if not self._distances:
            self._distances.append((tick.time_s - tick.dt_s, 0.0, 0.0))
        _, distance_before_m, apart_before_m = self._distances[-1]
        self._distances.append((tick.time_s, distance_before_m + distance_m, apart_before_m + apart_m))
        begin_s = tick.time_s - tick.dt_s
        for fix in tick.fixes:
            if math.isfinite(fix.speed_mps) and fix.speed_noise <= SLIP_SLOPE.max_speed_noise:
                self._fixes.append((begin_s + fix.fraction * tick.dt_s, fix))
        while self._distances[1][0] < tick.time_s - 3.0 * SLIP_SLOPE.span_s:
            self._distances.popleft()
        out = []
        while self._fixes and self._fixes[0][0] + SLIP_SLOPE.span_s <= tick.time_s:
            at_s, fix = self._fixes.popleft()
            point = self._slip_of_second(at_s, fix)
            if point is not None:
                out += self._end_second(at_s)
                self._second.append(point)
        return out

    def _slip_of_second(self, at_s: float, fix: Fix) -> SlipSecond | None:
        """Return acceleration and slip about a fix's time; None where too slow, in a bend, or not covered."""
        times, distances, aparts = zip(*self._distances, strict=True)
        span_s = SLIP_SLOPE.span_s
        if at_s - span_s < times[0]:
            return None
        moments = at_s + span_s * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
        first, before, now, after, last = np.interp(moments, times, distances).tolist()
        apart_before, apart_after = np.interp(moments[[1, 3]], times, aparts).tolist()
        speed_mps, accel_mps2 = (after - before) / span_s, (last - 2.0 * now + first) / span_s**2
        least, most = SLIP_SLOPE.accel_mps2
        slowest_mps = SLIP_SLOPE.slowest_against_receiver_mps
        if min(speed_mps, fix.speed_mps) < slowest_mps or not least < accel_mps2 < most:
            return None
        bend = (apart_after - apart_before) / self._track_m / (after - before) * self._wheelbase_m
        if abs(bend) > SLIP_SLOPE.max_bend:
            return None
        # In a bend the front wheels, half of all, roll further than the rear ones.
        slip = math.log(speed_mps / fix.speed_mps) - 0.25 * math.log1p(bend * bend)
        return SlipSecond(accel_mps2, slip, accel_mps2 / speed_mps)

    def _end_second(self, at_s: float) -> list[SlipSecond]:
        """Return the mean of the points of the last second as a list, empty while it is not over: those of
        fast receivers are similar."""
        if at_s - self._second_from_s < SLIP_SLOPE.second_s:
            return []
        points, self._second, self._second_from_s = self._second, [], at_s
        if not points:
            return []
        return [SlipSecond(*(sum(values) / len(points) for values in zip(*points, strict=True)))]
