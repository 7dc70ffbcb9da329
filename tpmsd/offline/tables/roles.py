"""Roles of a table's columns, and their units.

In: a column's name with its unit as suffix (`wheel_speed_fl_kmh`), or a role with a unit (`wheel_speed_fl`,
`km/h`). Out: the role, and factor and offset to SI. Roles are those of `vehicle.toml`, and `wheel_angle_*`.
"""

from __future__ import annotations

import math

from tpmsd.car.config.model import OPTIONAL_ROLES
from tpmsd.car.config.units import to_si
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS

Scale = tuple[float, float]
"""SI value = factor * value + offset."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_ONE: dict[str, Scale] = {"m": (1.0, 0.0)}
_ANGLE: dict[str, Scale] = {"rad": (1.0, 0.0), "deg": (math.pi / 180.0, 0.0)}
_SPEED: dict[str, Scale] = {"m/s": (1.0, 0.0), "km/h": (1 / 3.6, 0.0), "kn": (1852.0 / 3600.0, 0.0)}
_TIME: dict[str, Scale] = {unit: (factor, 0.0) for unit, factor in TIME_UNITS.items()}
_DEGREES: dict[str, Scale] = {"deg": (1.0, 0.0), "rad": (180.0 / math.pi, 0.0)}
_PURE: dict[str, Scale] = {"1": (1.0, 0.0)}

GNSS_UNITS: dict[str, dict[str, Scale]] = {
    "gnss_arrival": _TIME,
    "gnss_utc": _TIME,
    "gnss_latitude": _DEGREES,
    "gnss_longitude": _DEGREES,
    "gnss_altitude": _ONE,
    "gnss_east": _ONE,
    "gnss_north": _ONE,
    "gnss_position_std": _ONE,
    "gnss_speed": _SPEED,
    "gnss_course": _ANGLE,
    "gnss_heading": _ANGLE,
    "gnss_quality": _PURE,
    "gnss_hdop": _PURE,
}
"""Role -> its units, the default first. `gnss_course` is clockwise from north, `gnss_heading`
counter-clockwise from east; `gnss_east` and `gnss_north` are a simulator's plane, in place of latitude and
longitude. GNSS speeds have the knot, which NMEA uses and no CAN signal does."""
ANGLE_ROLES = tuple(f"wheel_angle_{wheel}" for wheel in WHEELS)
STD_ROLES = tuple(f"wheel_rotation_std_{wheel}" for wheel in WHEELS)
"""Standard deviation of a tick's rotation by quantisation, quantum / sqrt 6, of an angle that was counted."""
SPEED_ROLES = tuple(f"wheel_speed_{wheel}" for wheel in WHEELS)
COUNT_ROLES = tuple(f"wheel_count_{wheel}" for wheel in WHEELS)
ROLES = (*ANGLE_ROLES, *STD_ROLES, *SPEED_ROLES, *COUNT_ROLES, *OPTIONAL_ROLES, *GNSS_UNITS)
INERTIAL_UNITS = {
    "yaw_rate": "rad/s",
    "accel_long": "m/s2",
    "accel_lat": "m/s2",
    "steering_wheel_angle": "rad",
    "brake_pressure": "Pa",
    "drive_torque": "Nm",
    "ambient_temp": "K",
}
SUFFIXES = {
    "s": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "rad": "rad",
    "deg": "deg",
    "radps": "rad/s",
    "degps": "deg/s",
    "dps": "deg/s",
    "rpm": "rpm",
    "mps": "m/s",
    "kmh": "km/h",
    "kph": "km/h",
    "kn": "kn",
    "m": "m",
    "mps2": "m/s2",
    "g": "g",
    "pa": "Pa",
    "kpa": "kPa",
    "bar": "bar",
    "nm": "Nm",
    "k": "K",
    "degc": "degC",
}
"""Suffix of a column's name -> unit."""


def scale_of(role: str, unit: str | None) -> Scale:
    """Return the factor and offset to SI units; `unit` None is SI. ConfigError for a unit that the role
    cannot have.
    """
    if role in COUNT_ROLES:
        if unit not in (None, "", "1"):
            raise ConfigError(f"a count has no unit, found {unit!r}")
        return 1.0, 0.0
    units = _ANGLE if role in (*ANGLE_ROLES, *STD_ROLES) else GNSS_UNITS.get(role)
    if units is not None:
        if unit is None:
            return next(iter(units.values()))
        if unit not in units:
            raise ConfigError(f"no unit of {role}: {unit!r}; allowed: {' '.join(units)}")
        return units[unit]
    default = "rad/s" if role in SPEED_ROLES else INERTIAL_UNITS[role]
    return to_si(role, default if unit is None else unit)


def is_road_speed(role: str, unit: str | None) -> bool:
    """Return whether a wheel speed is one along the road, to be divided by the nominal radius."""
    return role in SPEED_ROLES and unit is not None and unit not in ("rad/s", "deg/s", "rpm")


def split_name(name: str, prefix: str = "") -> tuple[str, str | None] | None:
    """Return role and unit of a column's name, `prefix` put in front where it is missing; None if it is no
    role.
    """
    for candidate in (name, prefix + name):
        if candidate in ROLES:
            return candidate, None
        stem, _, suffix = candidate.rpartition("_")
        if stem in ROLES and suffix in SUFFIXES:
            return stem, SUFFIXES[suffix]
    return None
