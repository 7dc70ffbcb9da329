"""Events that the sources hand to the timeline: decoded readings, each with its host time stamp.

In: nothing (plain records). Out: `RotationSample`, `InertialSample`, `GnssFix`, `SourceFault`.
All times are seconds of the host clock as stamped on arrival (CAN frame or first byte of a sentence).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

NAN = math.nan


class RotationSample(NamedTuple):
    """One reading of one wheel's rotation, as an exact unwrapped angle ([Lundquist 2013], eq. 37).

    A named tuple, because a drive has hundreds of thousands.
    """

    time_s: float
    wheel: int
    """Index into `tpmsd.foundation.wheels.WHEELS`."""
    angle_rad: float
    """Angle turned since the segment began; exact sum of counts (or integral of a speed signal)."""
    quantum_rad: float
    """Resolution of the angle: one count; 0 for integrated speeds."""
    segment: int
    """Rises by one whenever continuity is lost (reset, jump, long gap): angles of different segments
    must never be subtracted."""


class RotationRun(NamedTuple):
    """`RotationSample`s of one wheel and one segment in columns, each newer than the one before it."""

    wheel: int
    segment: int
    quantum_rad: float
    frame_indices: list[int]
    """Indices of their frames in the log, in whatever numbers rise with them."""
    time_s: list[float]
    angle_rad: list[float]


class InertialSample(NamedTuple):
    """One reading of an optional signal, in SI units and ISO 8855 signs; a named tuple as above."""

    time_s: float
    role: str
    """yaw_rate | accel_long | accel_lat | steering_wheel_angle | brake_pressure | drive_torque |
    ambient_temp"""
    value: float


@dataclass(frozen=True, slots=True)
class GnssFix:
    """One epoch of the receiver, gathered from all sentences that speak of it. NaN where it said nothing."""

    arrival_s: float
    """Host time at which the epoch's first sentence arrived."""
    utc_s: float
    """The receiver's own time of validity, Unix seconds (NaN if it gave none)."""
    latitude_deg: float = NAN
    longitude_deg: float = NAN
    altitude_m: float = NAN
    """Height above the ellipsoid where the geoid separation is known, else above mean sea level."""
    quality: int = 0
    """GGA quality: 0 none, 1 autonomous, 2 differential, 4 RTK fixed, 5 RTK float, 6 dead reckoning."""
    hdop: float = NAN
    position_std_m: float = NAN
    """Horizontal one-sigma per axis from GST, else from quality and HDOP; never NaN if a position is
    given."""
    speed_mps: float = NAN
    speed_std_mps: float = NAN
    """Standard deviation of the speed, where the receiver states one."""
    course_rad: float = NAN
    """Clockwise from true north, in [0, 2 pi), as NMEA has it."""


@dataclass(frozen=True, slots=True)
class SourceFault:
    """Something wrong with an input that was detected, counted and rejected before the estimate."""

    time_s: float
    source: str
    """can | gnss"""
    kind: str
    """Kind of fault, for example lost, repeated, late, reset, jump, stuck, timeout, checksum, garbage,
    unplugged."""
    detail: str = ""
    wheel: int | None = None


Event = RotationSample | InertialSample | GnssFix | SourceFault
