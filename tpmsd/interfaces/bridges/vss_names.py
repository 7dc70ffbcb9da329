"""Names of the Vehicle Signal Specification that the code speaks of; `vss.dbc` has those that are read.

Source: COVESA Vehicle Signal Specification, release 6.0: branch
Vehicle.Chassis.Axle.Row<n>.Wheel.<Left|Right>, `Tire.IsPressureLow` (boolean, sensor, the same since 3.0),
`Speed` (float, km/h: the rotation by the car's own radius), `AngularSpeed` (float, degrees/s, since 5.0),
and Vehicle.CurrentLocation. Row 1 is the front axle. VSS has `Tire.Pressure` too; tpmsd measures none and
does not write it.
"""

from __future__ import annotations

IS_PRESSURE_LOW = {
    wheel: f"Vehicle.Chassis.Axle.{row}.Wheel.{side}.Tire.IsPressureLow"
    for wheel, row, side in (
        ("fl", "Row1", "Left"),
        ("fr", "Row1", "Right"),
        ("rl", "Row2", "Left"),
        ("rr", "Row2", "Right"),
    )
}
"""Wheel to path; a boolean."""
MEANS_LOW = frozenset({"deflation", "slow_leak"})
"""Kinds of alarms that say that a tyre has lost air; `radius_deviation` may be a larger tyre as well."""
WHEEL_SPEEDS = (".Speed", ".AngularSpeed")
GNSS_TIME = "Vehicle.CurrentLocation.Timestamp"
"""A text by ISO 8601."""
FIX_TYPE = "Vehicle.CurrentLocation.GNSSReceiver.FixType"
"""A text, `NONE` where there is no fix."""


def is_wheel(path: str) -> bool:
    """Return whether a path is the speed of a wheel."""
    return ".Wheel." in path and path.endswith(WHEEL_SPEEDS)
