"""Ticks that the timeline hands to the estimator: one record per fixed-rate tick.

In: nothing (plain records). Out: `Tick`, `Fix`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.events import SourceFault

NAN = math.nan


@dataclass(frozen=True, slots=True)
class Fix:
    """A GNSS fix in the local plane, placed at the time it was valid. NaN where the receiver was silent."""

    time_s: float
    """Host time at which the fix was valid (its own UTC plus the tracked clock offset)."""
    fraction: float
    """Position of the fix in its tick: 0 at the tick's start, 1 at its end."""
    east_m: float
    north_m: float
    position_std_m: float
    up_m: float = NAN
    """Height, for the grade; the estimate of radii does not need it."""
    speed_mps: float = NAN
    heading_rad: float = NAN
    """Course over ground as a mathematical angle: counter-clockwise from east."""
    quality: int = 1
    arrival_lag_s: float = NAN
    """Arrival minus validity."""
    speed_noise: float = 1.0
    """Factor by which the error of speed and course is greater than usual, as the receiver states it."""
    utc_s: float = NAN
    """The receiver's own time of validity, Unix seconds."""

    def with_position_std(self, position_std_m: float) -> Fix:
        """Return the fix with another standard deviation of its position; `replace` takes four times as long,
        and some receivers' fixes all need it."""
        return Fix(
            *(self.time_s, self.fraction, self.east_m, self.north_m, position_std_m, self.up_m),
            *(self.speed_mps, self.heading_rad, self.quality, self.arrival_lag_s, self.speed_noise),
            self.utc_s,
        )


@dataclass(frozen=True, slots=True)
class Tick:
    """Measurements of one interval (time_s - dt_s, time_s]."""

    index: int
    time_s: float
    """End of the interval: host time with the clock's backward steps taken out, so it only ever rises."""
    dt_s: float
    rotation_rad: FloatArray
    """(4,) angle turned by each wheel in the interval; NaN where it is not known."""
    rotation_std_rad: FloatArray
    """(4,) standard deviation of that reading from the counts' quantisation."""
    fixes: tuple[Fix, ...] = ()
    yaw_rate_radps: float = NAN
    accel_long_mps2: float = NAN
    accel_lat_mps2: float = NAN
    steering_wheel_angle_rad: float = NAN
    brake_pressure_pa: float = NAN
    drive_torque_nm: float = NAN
    ambient_temp_k: float = NAN
    abs_active: float = NAN
    """Share of the interval's readings of this flag that are set; so the next two."""
    esc_active: float = NAN
    brake_active: float = NAN
    tyre_set: float = NAN
    """Number of the set of tyres that the car says is mounted."""
    host_time_s: float = NAN
    """End of the interval as the host clock had it; the time that is reported."""
    gap_s: float = 0.0
    """Time before this interval for which there are no ticks (a pause of the bus, a step of the clock)."""
    faults: tuple[SourceFault, ...] = field(default=())
