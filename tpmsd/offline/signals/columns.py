"""The files and columns of a table of signals.

In: a drive folder. Out: names. They are those of the tick table where it has them; SI units, ISO 8855 axes.
"""

from __future__ import annotations

from pathlib import Path

FILES = ("signals.csv", "signals.csv.gz", "signals.parquet")
"""Names in a drive folder, in the order in which they are looked for."""
TIME = "time_s"
STEERING_WHEEL, ROAD_WHEEL = "steering_wheel_angle_rad", "road_wheel_angle_rad"
DRIVE, BRAKE = "drive_force_n", "brake_force_n"
DRIVE_TORQUE, BRAKE_PRESSURE = "drive_torque_nm", "brake_pressure_pa"
OUTPUTS = {
    "yaw_rate": "yaw_rate_radps",
    "accel_long": "accel_long_mps2",
    "accel_lat": "accel_lat_mps2",
    "speed": "speed_mps",
    "velocity_lat": "velocity_lat_mps",
    "side_slip": "side_slip_rad",
    "roll": "roll_rad",
}
"""Column by the output's name."""
WHEELS = tuple(f"wheel_speed_{wheel}_radps" for wheel in ("fl", "fr", "rl", "rr"))
INPUTS = (STEERING_WHEEL, ROAD_WHEEL, DRIVE, BRAKE, DRIVE_TORQUE, BRAKE_PRESSURE)


def signals_file(folder: Path) -> Path | None:
    """Return the table of signals in a drive folder; None where there is none."""
    return next((folder / name for name in FILES if (folder / name).is_file()), None)


def is_known(name: str) -> bool:
    """Return True if a column is one that a table of signals may have."""
    return (
        name == TIME
        or name in INPUTS
        or name in OUTPUTS.values()
        or name in WHEELS
        or (name.startswith("gnss_") and name.isascii() and name.isidentifier())
    )
