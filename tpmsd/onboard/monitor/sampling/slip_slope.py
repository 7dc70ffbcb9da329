"""Slip slope: slip of the driven wheels per acceleration, by which low grip is known.

In: ticks. Out: `SlopeSums`, the regression of one window of driving after the other.

The slip of the driven wheels against the others is in proportion to the force that they transmit, and the
steeper the less grip the road has [Gustafsson 1997, "Slip-based tire-road friction estimation", Automatica].
Within seconds radii, load and the road's slope hardly change, so within a window

    log(rotation of the driven axle / of the other one) = constant + slope * acceleration

Another radius shifts the constant and leaves the slope: so this tells low grip from two driven tyres that
have lost air, which one drive's radii alone do not. Where all wheels are driven none rolls freely, and the
receiver's speed takes that place (`receiver_slip`). It is that of `age` seconds ago, which looks like a slip
of age * acceleration / speed.
"""

from __future__ import annotations

import math

from tpmsd.car.config.model import VehicleConfig
from tpmsd.onboard.monitor.sampling.receiver_slip import ReceiverSlip
from tpmsd.onboard.monitor.sampling.slip_sums import SlipSecond, SlopeSums
from tpmsd.onboard.monitor.settings import SLIP_SLOPE
from tpmsd.onboard.timeline.tick import Tick


class SlipSlope:
    """Regression of slip on acceleration for one car all of whose wheels are monitored."""

    def __init__(self, vehicle: VehicleConfig) -> None:
        self._front = {"front": 1.0, "rear": -1.0}.get(vehicle.driven_axle, 0.0)
        """Sign of the front axle's rotation in the slip; 0: all are driven."""
        self._receiver = ReceiverSlip(vehicle) if self._front == 0.0 else None
        self._radius_m = [float(radius) for radius in vehicle.wheel_radius_m]
        self._wheelbase_m, self._track_m = vehicle.wheelbase_m, vehicle.track_rear_m
        self._distance_m = [0.0] * 4
        self._elapsed_s = 0.0
        self._seconds: list[tuple[float, float]] = []
        """Speed of the axle that is not driven, and slip, of each second in a row; the last two at least."""
        self._points: list[SlipSecond] = []
        self._window_s = 0.0

    def update(self, tick: Tick) -> SlopeSums | None:
        """Update by a tick; return the sums of a window that ends with it, else None."""
        if self._receiver is not None:
            self._points += self._receiver.update(tick)
        else:
            self._add_rotation(tick)
        self._window_s += tick.dt_s
        if self._window_s < SLIP_SLOPE.window_s:
            return None
        points, self._points, self._window_s = self._points, [], 0.0
        return SlopeSums.from_points(points)

    def _add_rotation(self, tick: Tick) -> None:
        """Add a tick's rotations to the present second; begin again after a gap."""
        if tick.gap_s > 0.0:
            self._interrupt()
        turns = tick.rotation_rad.tolist()
        self._distance_m = [
            distance_m + turn * radius
            for distance_m, turn, radius in zip(self._distance_m, turns, self._radius_m, strict=True)
        ]
        self._elapsed_s += tick.dt_s
        if self._elapsed_s >= SLIP_SLOPE.second_s:
            self._end_second()

    def _interrupt(self) -> None:
        """Drop the present second and those before it."""
        self._distance_m, self._elapsed_s = [0.0] * 4, 0.0
        self._seconds.clear()

    def _end_second(self) -> None:
        """Compute speed and slip of the second that ends; add a point for the one before it, if it is
        usable."""
        fl, fr, rl, rr = self._distance_m
        elapsed_s = self._elapsed_s
        self._distance_m, self._elapsed_s = [0.0] * 4, 0.0
        front, rear = 0.5 * (fl + fr), 0.5 * (rl + rr)
        free = rear if self._front > 0.0 else front
        slow_m = SLIP_SLOPE.slowest_mps * elapsed_s
        if not (front > slow_m and rear > slow_m):  # also where one is not known
            self._seconds.clear()
            return
        # In a bend the front wheels roll further than the rear ones.
        bend = (rr - rl) / self._track_m / rear * self._wheelbase_m
        slip = self._front * (math.log(front / rear) - 0.5 * math.log1p(bend * bend))
        self._seconds.append((free / elapsed_s, slip))
        if abs(bend) > SLIP_SLOPE.max_bend:
            self._seconds.clear()
        if len(self._seconds) < 3:
            return
        (before, _), (_, slip), (after, _) = self._seconds
        accel = (after - before) / (2.0 * elapsed_s)
        least, most = SLIP_SLOPE.accel_mps2
        if least < accel < most:
            self._points.append(SlipSecond(accel, slip))
        self._seconds.pop(0)
