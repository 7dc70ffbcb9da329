"""Gate of ticks: radii may be learned from informative ones.

In: one tick's odometry, inertial means and fixes. Out: smoothed speed, acceleration and yaw rate, and a
verdict. Slip and load transfer grow with force, and at low speed one cog is a large part of a tick, so only
gentle driving above a minimum speed (`min_speed_mps` of `config.model.FilterConfig`) is informative. Other
ticks still move the pose.

A soft rear tyre looks like a bend to the odometry (6 mm at 20 m/s: 0.27 rad/s), and a gate that trusted the
wheels would shut just then. So the lateral acceleration is judged by a yaw rate independent of the wheels
where there is one: the gyro, else the receiver's course, else (stale or none) the wheels.
"""

from __future__ import annotations

import math

from tpmsd.car.config.model import FilterConfig
from tpmsd.onboard.estimators.gates.gyro_check import GyroCheck
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick


class CourseRate:
    """Yaw rate as the receiver sees it, from its courses or, without them, from chords between its
    positions."""

    def __init__(self) -> None:
        self._anchor: Fix | None = None
        self._course: tuple[float, float] | None = None
        self.rate_radps = math.nan
        self.time_s = -math.inf

    def update(self, fix: Fix) -> None:
        """Update the yaw rate by a fix."""
        if math.isfinite(fix.heading_rad):
            self._add_course(fix.time_s, fix.heading_rad)
            return
        anchor = self._anchor
        if anchor is None or fix.time_s - anchor.time_s > SETTINGS.course_rate_fresh_s:
            self._anchor = fix
            return
        span_s = fix.time_s - anchor.time_s
        east, north = fix.east_m - anchor.east_m, fix.north_m - anchor.north_m
        if math.hypot(east, north) >= SETTINGS.course_rate_chord_m and span_s >= SETTINGS.course_rate_span_s:
            self._anchor = fix
            self._add_course((fix.time_s + anchor.time_s) / 2, math.atan2(north, east))

    def _add_course(self, time_s: float, course_rad: float) -> None:
        """Set the yaw rate by the change of course since the last one used, once that is long enough ago."""
        if self._course is not None:
            elapsed = time_s - self._course[0]
            if elapsed < SETTINGS.course_rate_span_s:
                return
            if elapsed <= SETTINGS.course_rate_fresh_s:
                turned = math.remainder(course_rad - self._course[1], 2 * math.pi)
                self.rate_radps, self.time_s = turned / elapsed, time_s
        self._course = (time_s, course_rad)


class MotionGate:
    """Smooths the odometry just enough for accelerations to rise out of the quantisation."""

    def __init__(self, settings: FilterConfig) -> None:
        self._settings = settings
        self._course = CourseRate()
        self._gyro = GyroCheck()
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far (after a gap)."""
        self.speed_mps = math.nan
        self.yaw_rate_radps = 0.0
        self.accel_mps2 = 0.0

    def update(self, tick: Tick, speed_mps: float, yaw_rate_radps: float) -> bool:
        """Update by one tick's wheel speed and yaw rate; return whether this tick is informative."""
        if math.isnan(self.speed_mps):
            self.speed_mps, self.yaw_rate_radps = speed_mps, yaw_rate_radps
            return False
        share = 1.0 - math.exp(-tick.dt_s / SETTINGS.gate_smoothing_s)
        before = self.speed_mps
        self.speed_mps += share * (speed_mps - before)
        self.yaw_rate_radps += share * (yaw_rate_radps - self.yaw_rate_radps)
        self.accel_mps2 += share * ((self.speed_mps - before) / tick.dt_s - self.accel_mps2)
        yaw_rate = self._independent_yaw_rate(tick)
        gentle = self._is_gentle(tick, yaw_rate)
        slowest = self._settings.min_speed_mps
        fast = speed_mps >= slowest and self.speed_mps >= slowest
        return fast and gentle and abs(yaw_rate) <= SETTINGS.max_curvature_per_m * self.speed_mps

    def check_gyro(self, tick: Tick, yaw_rate_radps: float) -> None:
        """Compare the bus's yaw rate with one that was smoothed over `SETTINGS.gate_smoothing_s`.

        That is the one that the filter estimates, not the wheels' by nominal radii: in bends the outer wheels
        carry more (`load_transfer_lateral`), and at 30 m/s they show 1.4 times the turn of a usual car.
        """
        if self.speed_mps >= self._settings.min_speed_mps:  # false for NaN
            self._gyro.update(tick.yaw_rate_radps, yaw_rate_radps, tick.dt_s)

    def _is_gentle(self, tick: Tick, yaw_rate_radps: float) -> bool:
        """Return whether forces are small and nothing brakes. `yaw_rate_radps` is independent of the wheels
        where that is possible."""
        if tick.brake_active > 0.0 or tick.abs_active > 0.0 or tick.esc_active > 0.0:  # false for NaN
            return False
        accel_long = self._accel_long(tick)
        accel_lat = self.speed_mps * yaw_rate_radps
        limits = self._settings
        return abs(accel_long) <= limits.max_accel_long_mps2 and abs(accel_lat) <= limits.max_accel_lat_mps2

    def _accel_long(self, tick: Tick) -> float:
        """Return the larger in magnitude of the accelerometer's and the wheels' longitudinal acceleration,
        m/s^2: wheels that spin on ice or are locked gain and lose speed while the car does not."""
        wheels, body = self.accel_mps2, tick.accel_long_mps2
        return body if abs(body) > abs(wheels) else wheels  # false for NaN

    @property
    def gyro_trusted(self) -> bool:
        """True if the bus's yaw rate was found to be one."""
        return self._gyro.trusted

    def _independent_yaw_rate(self, tick: Tick) -> float:
        """Return the yaw rate by the gyro, else by the receiver's courses, else by the wheels, rad/s."""
        for fix in tick.fixes:
            self._course.update(fix)
        if self.gyro_trusted and math.isfinite(tick.yaw_rate_radps):
            return tick.yaw_rate_radps
        if abs(tick.time_s - self._course.time_s) <= SETTINGS.course_rate_fresh_s:
            return self._course.rate_radps
        return self.yaw_rate_radps
