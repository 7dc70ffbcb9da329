"""Names of the Vehicle Signal Specification that tpmsd has something to say of, in one table.

Source: COVESA Vehicle Signal Specification, release 6.0 (the same since 3.0): branch
Vehicle.Chassis.Axle.Row<n>.Wheel.<Left|Right>.Tire, `IsPressureLow` (boolean, sensor). Row 1 is the front
axle. VSS has `Tire.Pressure` too; tpmsd measures none and does not write it.
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
