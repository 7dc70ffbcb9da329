"""The columns of the tick table: name, unit and meaning.

In: nothing. Out: `COLUMNS`, in the order in which every writer puts them. docs/how-to/python.md lists them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from tpmsd.foundation.wheels import WHEELS


@dataclass(frozen=True, slots=True)
class Column:
    """Name, unit and meaning of one column of the table of ticks."""

    name: str
    """Name with the unit as suffix."""
    unit: str
    """SI; `1` for pure numbers, empty for text."""
    meaning: str
    text: bool = False


def _wheel_columns(stem: str, suffix: str, unit: str, meaning: str, text: bool = False) -> tuple[Column, ...]:
    return tuple(Column(f"{stem}_{wheel}{suffix}", unit, f"{wheel}: {meaning}", text) for wheel in WHEELS)


TIME = (
    Column("time_s", "s", "end of the tick on the drive's host clock"),
    Column("drive_time_s", "s", "the same since the drive's start"),
    Column("gap_s", "s", "time before this tick for which there are no ticks"),
)
WHEEL = (
    *_wheel_columns(
        "wheel_angle", "_rad", "rad", "angle turned since the start; empty where it was not read"
    ),
    *_wheel_columns(
        "wheel_rotation_std", "_rad", "rad", "reading error of the tick's rotation by quantisation"
    ),
)
INERTIAL = (
    Column("yaw_rate_radps", "rad/s", "yaw rate of the bus, positive in a left turn"),
    Column("accel_long_mps2", "m/s2", "longitudinal specific force of the bus"),
    Column("accel_lat_mps2", "m/s2", "lateral specific force of the bus, positive to the left"),
    Column("steering_wheel_angle_rad", "rad", "steering wheel angle of the bus, positive to the left"),
    Column("brake_pressure_pa", "Pa", "brake pressure of the bus"),
    Column("drive_torque_nm", "Nm", "drive torque of the bus"),
    Column("ambient_temp_k", "K", "ambient temperature of the bus"),
)
GNSS = (
    Column("gnss_arrival_s", "s", "host time at which the fix in this row arrived; empty without a fix"),
    Column("gnss_utc_s", "s", "the receiver's own time of validity, Unix seconds"),
    Column("gnss_latitude_deg", "deg", "latitude, WGS 84"),
    Column("gnss_longitude_deg", "deg", "longitude, WGS 84"),
    Column("gnss_altitude_m", "m", "height"),
    Column("gnss_position_std_m", "m", "standard deviation of the position per axis"),
    Column("gnss_speed_mps", "m/s", "speed over ground"),
    Column("gnss_course_rad", "rad", "course over ground, clockwise from true north"),
    Column("gnss_quality", "1", "GGA quality: 0 none, 1 autonomous, 2 differential, 4 RTK, 5 RTK float"),
    Column("gnss_hdop", "1", "horizontal dilution of precision"),
)
ESTIMATE = (
    Column("speed_mps", "m/s", "estimated speed"),
    Column("estimated_yaw_rate_radps", "rad/s", "estimated yaw rate"),
    Column("east_m", "m", "estimated position in the plane of the first fix"),
    Column("north_m", "m", "estimated position in the plane of the first fix"),
    Column("heading_rad", "rad", "estimated heading, counter-clockwise from east"),
    Column("position_std_m", "m", "standard deviation of the estimated position per axis"),
    Column("heading_std_rad", "rad", "standard deviation of the estimated heading"),
    Column("gnss_age_s", "s", "time since the last fix that was used"),
    Column("informative", "1", "1 where the tick was informative driving, else 0"),
    Column("learning_fraction", "1", "share of the baseline that is learned"),
    *_wheel_columns("deviation", "_m", "m", "radius minus nominal"),
    *_wheel_columns("deviation_std", "_m", "m", "its standard deviation"),
    *_wheel_columns("change", "_m", "m", "radius minus the learned baseline; empty while it is learned"),
    *_wheel_columns("change_std", "_m", "m", "its standard deviation"),
    *_wheel_columns("deflation_probability", "", "1", "probability of a deflation"),
    *_wheel_columns("state", "", "", "unavailable, learning, monitoring or alarm", text=True),
    Column("alarms", "", "alarms that stand, as kind:wheel, separated by blanks", text=True),
    Column("faults", "1", "faults of bus, receiver and clock in this tick"),
)
VEHICLE_STATE = (
    Column("velocity_long_mps", "m/s", "longitudinal speed of the centre of gravity"),
    Column("velocity_long_std_mps", "m/s", "its standard deviation"),
    Column("velocity_lat_mps", "m/s", "lateral speed of the centre of gravity, positive to the left"),
    Column("velocity_lat_std_mps", "m/s", "its standard deviation"),
    Column("side_slip_rad", "rad", "side slip angle of the centre of gravity"),
    Column("side_slip_std_rad", "rad", "its standard deviation"),
    Column("yaw_rate_estimate_radps", "rad/s", "yaw rate of the filter of the vehicle state"),
    Column("yaw_rate_estimate_std_radps", "rad/s", "its standard deviation"),
)
"""Columns of a table of a drive whose vehicle state is estimated; the fields of `VehicleState`."""
COLUMNS = (*TIME, *WHEEL, *INERTIAL, *GNSS, *ESTIMATE)
NUMBERS = tuple(column.name for column in COLUMNS if not column.text)
TEXTS = tuple(column.name for column in COLUMNS if column.text)
BY_NAME = {column.name: column for column in (*COLUMNS, *VEHICLE_STATE)}


def columns_of(numbers: Collection[str]) -> tuple[Column, ...]:
    """Return the table's columns in their documented order, given the names of its numeric columns."""
    return (*COLUMNS, *(column for column in VEHICLE_STATE if column.name in numbers))


def markdown() -> str:
    """Return the columns as a table for the docs, a row for all four wheels together."""
    rows = ["| column | unit | meaning |", "| --- | --- | --- |"]
    for column in (*COLUMNS, *VEHICLE_STATE):
        name, meaning = column.name, column.meaning
        wheel = meaning[:2] if meaning[2:4] == ": " else ""
        if wheel and wheel != WHEELS[0]:
            continue
        if wheel:
            name, meaning = name.replace(f"_{wheel}", "_*", 1), meaning[4:]
        rows.append(f"| `{name}` | {column.unit} | {meaning} |")
    return "\n".join(rows)
