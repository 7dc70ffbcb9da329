"""Units of CAN signals: from the spelling in a DBC to a factor and an offset to SI.

In: a role (`yaw_rate`, `wheel_speed_fl`, ...) and the unit text of its signal. Out: `(factor, offset)` with
SI value = factor * value + offset, or a `ConfigError` that names what is allowed. A wheel speed becomes m/s
if its unit is one of the road and rad/s if it is one of rotation; `wheel_speed_kind` tells which.
"""

from __future__ import annotations

import math
import unicodedata
from typing import Final, Literal

from tpmsd.car.config.model import FLAG_ROLES
from tpmsd.foundation.errors import ConfigError

_G_MPS2 = 9.80665  # standard gravity, by definition of the unit g (CGPM 1901)

Kind = Literal[
    "count",
    "linear speed",
    "angular speed",
    "angle",
    "acceleration",
    "pressure",
    "torque",
    "temperature",
    "length",
    "time",
    "flag",
]

UNITS: Final[dict[str, tuple[Kind, float, float]]] = {
    "km/h": ("linear speed", 1 / 3.6, 0.0),
    "m/s": ("linear speed", 1.0, 0.0),
    "mph": ("linear speed", 0.44704, 0.0),
    "rpm": ("angular speed", 2 * math.pi / 60, 0.0),
    "rad/s": ("angular speed", 1.0, 0.0),
    "deg/s": ("angular speed", math.pi / 180, 0.0),
    "deg": ("angle", math.pi / 180, 0.0),
    "rad": ("angle", 1.0, 0.0),
    "m/s2": ("acceleration", 1.0, 0.0),
    "g": ("acceleration", _G_MPS2, 0.0),
    "bar": ("pressure", 1e5, 0.0),
    "mbar": ("pressure", 1e2, 0.0),
    "kPa": ("pressure", 1e3, 0.0),
    "MPa": ("pressure", 1e6, 0.0),
    "Pa": ("pressure", 1.0, 0.0),
    "Nm": ("torque", 1.0, 0.0),
    "degC": ("temperature", 1.0, 273.15),
    "K": ("temperature", 1.0, 0.0),
    "degF": ("temperature", 5 / 9, 459.67 * 5 / 9),
    "knots": ("linear speed", 1852 / 3600, 0.0),
    "psi": ("pressure", 6894.757293168, 0.0),
    "%g": ("acceleration", 0.01 * _G_MPS2, 0.0),
    "cNm": ("torque", 0.01, 0.0),
    "m": ("length", 1.0, 0.0),
    "km": ("length", 1e3, 0.0),
    "ft": ("length", 0.3048, 0.0),
    "s": ("time", 1.0, 0.0),
    "ms": ("time", 1e-3, 0.0),
}
"""Canonical unit -> what it measures, factor and offset to SI (m/s, rad/s, rad, m/s2, Pa, N m, K, m, s)."""

_SPELLINGS: Final[dict[str, tuple[str, ...]]] = {
    "km/h": ("kph", "kmh", "kmph", "km/hr", "km/std", "km/hour", "km.h-1", "kmh-1", "km^h",
             "kilometerperhour", "kilometrperhour", "km/hs"),
    "m/s": ("mps", "ms-1", "m.s-1", "m/sec", "meter/s", "metre/s", "meterpersecon", "meterpersecond",
            "meters/second", "meter/second", "meters/s"),
    "mph": ("mi/h", "miles/h", "mile/h", "mileperhour"),
    "knots": ("kn", "knot", "kt", "kts"),
    "rpm": ("1/min", "/min", "min-1", "rev/min", "r/min", "u/min", "revs/min", "rev/m",
            "minutinver", "rpm/min"),
    "rad/s": ("rad/sec", "rads-1", "rad.s-1", "radps", "rads", "radian/s", "radians/s", "radians/second",
              "radpersecon"),
    "deg/s": ("deg/sec", "°/s", "°/sec", "\ufffd/s", "\ufffd/sec", "degps", "dps", "degree/s", "degrees/s",
              "grad/s", "degs-1", "deg.s-1", "degrees/second", "degree/second", "degreofarcpersecon",
              "°/second"),
    "deg": ("°", "\ufffd", "degree", "degrees", "grad", "degreofarc", "degreescw"),
    "rad": ("radian", "radians"),
    "m/s2": ("m/s^2", "m/s**2", "m/s/s", "m/sec2", "m/sec^2", "mps2", "m.s-2", "ms-2", "m/ss", "m/(s^2)",
             "m/(s2)", "m/(s.s)", "m/s\ufffd", "meter/s2", "meters/s2", "meterperseconsquar",
             "meter/second^2", "meters/second^2"),
    "g": ("gravity", "g0", "gn", "forceofgravi"),
    "%g": ("percentofforceofgravi",),
    "bar": ("bars",),
    "mbar": ("hpa", "millibar"),
    "kPa": ("kilopascal", "kpag", "kilopasca"),
    "psi": ("lb/in2",),
    "MPa": ("megapascal",),
    "Pa": ("pascal",),
    "Nm": ("n.m", "n-m", "newtonmeter", "newton.meter", "newtonmeters", "newtometer"),
    "cNm": ("centinewtometer",),
    "degC": ("°c", "\ufffdc", "c", "celsius", "degcelsius", "degreec", "degreescelsius", "gradc",
             "degrecelsi", "degreesc"),
    "K": ("kelvin", "degk", "°k"),
    "m": ("meter", "meters", "metre", "metres"),
    "km": ("kilometer", "kilometre", "kilometers"),
    "ft": ("feet", "foot"),
    "s": ("sec", "second", "seconds", "secon"),
    "ms": ("millisecond", "milliseconds", "msec", "millisecon"),
    "degF": ("°f", "\ufffdf", "f", "fahrenheit"),
}  # fmt: skip

_CANONICAL: Final[dict[str, str]] = {unit.casefold(): unit for unit in UNITS} | {
    spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings
}

_ROLE_KINDS: Final[dict[str, tuple[Kind, ...]]] = {
    "yaw_rate": ("angular speed",),
    "accel_long": ("acceleration",),
    "accel_lat": ("acceleration",),
    "steering_wheel_angle": ("angle",),
    "brake_pressure": ("pressure",),
    "drive_torque": ("torque",),
    "ambient_temp": ("temperature",),
    **dict.fromkeys((*FLAG_ROLES, "gnss_fix"), ("flag",)),
    "gnss_latitude": ("angle",),
    "gnss_longitude": ("angle",),
    "gnss_altitude": ("length",),
    "gnss_speed": ("linear speed",),
    "gnss_course": ("angle",),
    "gnss_utc": ("time",),
}

# What buses commonly carry, for the many DBC files that leave the unit empty.
_ASSUMED: Final[dict[str, str]] = {
    "yaw_rate": "deg/s",
    "accel_long": "m/s2",
    "accel_lat": "m/s2",
    "steering_wheel_angle": "deg",
    "brake_pressure": "bar",
    "drive_torque": "Nm",
    "ambient_temp": "degC",
    "gnss_latitude": "deg",
    "gnss_longitude": "deg",
    "gnss_altitude": "m",
    "gnss_speed": "km/h",
    "gnss_course": "deg",
    "gnss_utc": "s",
}


def canonical_unit(unit: str | None) -> str | None:
    """Return the unit as this project spells it; None if the text is empty or names no unit known here."""
    # A UTF-8 degree sign or superscript that was read as Latin-1 has a stray A circumflex in front.
    text = (unit or "").replace("Â", "").replace("º", "°").replace("˚", "°")
    text = unicodedata.normalize("NFKC", text).casefold()
    for multiplied in ("·", "⋅", "∙", "•", "×", "\u02d9"):
        text = text.replace(multiplied, ".")
    text = "".join(text.split()).strip("[]").replace("−", "-")
    text = text.removeprefix("unit_")  # German makers' DBC files: Unit_KiloMeterPerHour
    if text.startswith("(") and text.endswith(")"):
        text = text[1:-1]
    if text.endswith("*m"):
        text = text.replace("*m", ".m")
    return _CANONICAL.get(text)


def stated_unit(unit: str | None) -> str:
    """Return the DBC's unit without blanks around it; '' where it states none (as '-', 'none' and '1' do)."""
    text = (unit or "").strip()
    return (
        ""
        if text.casefold() in ("-", "--", "1", "none", "n/a", "na", "unitless", "[]", "[-]", "unit_none")
        else text
    )


def role_kinds(role: str) -> tuple[Kind, ...]:
    """Return the kinds of quantity that a role may measure; a `ConfigError` for a role that does not
    exist."""
    if role.startswith("wheel_count_"):
        return ("count",)
    if role.startswith("wheel_speed_"):
        return ("linear speed", "angular speed")
    try:
        return _ROLE_KINDS[role]
    except KeyError:
        raise ConfigError(f"no such role: {role!r}") from None


def allowed_units(role: str) -> tuple[str, ...]:
    """Return the units (canonical spelling) that the signal of a role may have; none for counters."""
    kinds = role_kinds(role)
    # A yaw rate in rpm is somebody's engine speed.
    refused = ("rpm",) if role == "yaw_rate" else ()
    return tuple(unit for unit, (kind, _, _) in UNITS.items() if kind in kinds and unit not in refused)


def assumed_unit(role: str) -> str | None:
    """Return the unit that is taken where the DBC states none; None for counters and flags, which need
    none."""
    kinds = role_kinds(role)
    if "count" in kinds or "flag" in kinds:
        return None
    return "km/h" if role.startswith("wheel_speed_") else _ASSUMED[role]


def to_si(role: str, unit: str | None) -> tuple[float, float]:
    """Return the factor and offset that turn a value in `unit` into the SI unit of `role`.

    An empty unit stands for `assumed_unit(role)`. Counters stay counts: (1.0, 0.0), unless their unit says
    that they are no counters. Raises `ConfigError` for a unit of the wrong kind or one that is not known.
    """
    kinds = role_kinds(role)
    canonical = canonical_unit(unit)
    stated = stated_unit(unit)
    if "count" in kinds:
        # A counter's unit is free text ("pulses", "edges"); only another quantity's unit is a contradiction,
        # and one letter is no proof: "c" and "k" stand for counts as well.
        if canonical is not None and len(stated) > 1:
            raise ConfigError(f"a counter cannot have the unit {stated!r} ({UNITS[canonical][0]})")
        return 1.0, 0.0
    if "flag" in kinds:
        return 1.0, 0.0
    if not stated:
        canonical = assumed_unit(role)
    if canonical is None or canonical not in allowed_units(role):
        what = "an unknown unit" if canonical is None else UNITS[canonical][0]
        raise ConfigError(
            f"unit {stated!r} is {what}; allowed for {' or '.join(kinds)}: {' '.join(allowed_units(role))}"
        )
    _, factor, offset = UNITS[canonical]
    return factor, offset


def wheel_speed_kind(unit: str | None) -> Literal["linear", "angular"]:
    """Return whether a wheel speed in `unit` is a speed over the road (SI: m/s) or of the wheel (SI:
    rad/s)."""
    to_si("wheel_speed_rl", unit)
    canonical = (canonical_unit(unit) if stated_unit(unit) else None) or "km/h"
    return "linear" if UNITS[canonical][0] == "linear speed" else "angular"
