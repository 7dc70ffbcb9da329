"""Units of CAN signals: spellings, factors, refusals."""

from __future__ import annotations

import math

import pytest

from tpmsd.car.config.model import OPTIONAL_ROLES, ROLES
from tpmsd.car.config.units import (
    allowed_units,
    assumed_unit,
    canonical_unit,
    role_kinds,
    to_si,
    wheel_speed_kind,
)
from tpmsd.foundation.errors import ConfigError


@pytest.mark.parametrize(
    ("role", "unit", "value", "si"),
    [
        ("wheel_speed_rl", "km/h", 90.0, 25.0),
        ("wheel_speed_rl", "m/s", 3.0, 3.0),
        ("wheel_speed_rl", "mph", 100.0, 44.704),
        ("wheel_speed_rl", "rpm", 60.0, 2 * math.pi),
        ("wheel_speed_rl", "rad/s", 7.0, 7.0),
        ("yaw_rate", "deg/s", 180.0, math.pi),
        ("yaw_rate", "rad/s", 0.5, 0.5),
        ("accel_long", "g", 1.0, 9.80665),
        ("accel_lat", "m/s2", -2.0, -2.0),
        ("steering_wheel_angle", "deg", -90.0, -math.pi / 2),
        ("steering_wheel_angle", "rad", 1.5, 1.5),
        ("brake_pressure", "bar", 2.0, 200_000.0),
        ("brake_pressure", "kPa", 2.0, 2_000.0),
        ("brake_pressure", "Pa", 2.0, 2.0),
        ("drive_torque", "Nm", 120.0, 120.0),
        ("ambient_temp", "degC", -273.15, 0.0),
        ("ambient_temp", "K", 300.0, 300.0),
        ("ambient_temp", "degF", 32.0, 273.15),
        ("wheel_count_fl", "", 77.0, 77.0),
        ("wheel_count_fl", "pulses", 77.0, 77.0),
    ],
)
def test_value_in_si(role: str, unit: str, value: float, si: float) -> None:
    """A value in the signal's unit becomes the value that physics books give in SI."""
    factor, offset = to_si(role, unit)
    assert pytest.approx(si, rel=1e-12, abs=1e-9) == factor * value + offset


@pytest.mark.parametrize(
    ("spelling", "unit"),
    [
        ("kph", "km/h"),
        ("km/hr", "km/h"),
        (" KM/H ", "km/h"),
        ("m/s^2", "m/s2"),
        ("m/s²", "m/s2"),
        ("m/sÂ²", "m/s2"),
        ("[m/s²]", "m/s2"),
        ("°", "deg"),
        ("º", "deg"),
        ("Â°/s", "deg/s"),
        ("°/s", "deg/s"),
        ("\ufffd/s", "deg/s"),
        ("1/min", "rpm"),
        ("rev/min", "rpm"),
        ("N.m", "Nm"),
        ("N·m", "Nm"),
        ("N*m", "Nm"),
        ("°C", "degC"),
        ("℃", "degC"),
        ("C", "degC"),
        ("K", "K"),
        ("Pa", "Pa"),
        ("furlong", None),
        ("", None),
        (None, None),
    ],
)
def test_spellings(spelling: str | None, unit: str | None) -> None:
    """The spellings met in real DBC files, encoding accidents among them, mean one unit each."""
    assert unit == canonical_unit(spelling)


@pytest.mark.parametrize(
    ("role", "unit"),
    [
        ("yaw_rate", "km/h"),
        ("yaw_rate", "rpm"),
        ("wheel_speed_fl", "deg"),
        ("accel_lat", "deg/s"),
        ("steering_wheel_angle", "%"),
        ("drive_torque", "%"),
        ("wheel_count_rr", "km/h"),
    ],
)
def test_wrong_kind(role: str, unit: str) -> None:
    """A unit of another quantity is refused in a line that names the unit and what is allowed."""
    with pytest.raises(ConfigError, match=unit) as caught:
        to_si(role, unit)
    assert len(str(caught.value).splitlines()) == 1
    assert all(allowed in str(caught.value) for allowed in allowed_units(role))


def test_unknown_role() -> None:
    """A role that does not exist is a configuration error, not a KeyError."""
    with pytest.raises(ConfigError, match="wheel_sped_fl"):
        to_si("wheel_sped_fl", "km/h")


@pytest.mark.parametrize("unit", ["", None, "-", " "])
def test_missing_unit_is_the_assumed_one(unit: str | None) -> None:
    """A signal without a unit converts as its assumed unit does."""
    for role in (*OPTIONAL_ROLES, "wheel_speed_rl"):
        assert to_si(role, assumed_unit(role)) == to_si(role, unit)


def test_assumed_units_are_allowed() -> None:
    """Whatever is assumed for a role is among what is allowed for it; counters need no unit."""
    for role in ROLES:
        assumed = assumed_unit(role)
        assert assumed in allowed_units(role) or (
            assumed is None and role_kinds(role) in (("count",), ("flag",))
        )


@pytest.mark.parametrize(
    ("unit", "kind"),
    [("km/h", "linear"), ("m/s", "linear"), ("", "linear"), ("rpm", "angular"), ("rad/s", "angular")],
)
def test_wheel_speed_kind(unit: str, kind: str) -> None:
    """Road units make a linear wheel speed, rotation units an angular one."""
    assert kind == wheel_speed_kind(unit)


def test_wheel_speed_kind_of_nonsense() -> None:
    """A wheel speed in bar is a configuration error."""
    with pytest.raises(ConfigError, match="bar"):
        wheel_speed_kind("bar")
